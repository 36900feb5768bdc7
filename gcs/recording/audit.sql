-- Tables of the audit, layout version 2 (gcs/recording/audit_database.py).
CREATE TABLE sessions (            -- one for each run of the service
  id TEXT PRIMARY KEY,             -- UTC date and time, and a number
  began_unix_s REAL NOT NULL,
  ended_unix_s REAL,               -- NULL: it runs, or did not end properly
  folder TEXT NOT NULL,            -- where its flight data lie
  config TEXT NOT NULL             -- the whole configuration, JSON
) WITHOUT ROWID;
CREATE TABLE calls (               -- of the REST API: all that may change something, and all that were denied
  session TEXT NOT NULL,
  unix_s REAL NOT NULL,
  caller TEXT NOT NULL,
  method TEXT NOT NULL,
  path TEXT NOT NULL,
  body TEXT NOT NULL,              -- shortened when long
  status INTEGER NOT NULL
);
CREATE TABLE commands (
  session TEXT NOT NULL,
  id TEXT NOT NULL,                -- as the API names it: o1, o2 ...; counted anew in every session
  accepted_unix_s REAL NOT NULL,
  caller TEXT NOT NULL,
  action TEXT NOT NULL,
  PRIMARY KEY (session, id)
) WITHOUT ROWID;
CREATE TABLE outcomes (            -- one row for each change, the first when the command is accepted
  session TEXT NOT NULL,
  command_id TEXT NOT NULL,
  vehicle TEXT NOT NULL,
  unix_s REAL NOT NULL,
  outcome TEXT NOT NULL,           -- pending, done, failed, not-included
  reason TEXT NOT NULL
);
CREATE INDEX outcomes_of ON outcomes (session, command_id);
CREATE TABLE events (              -- lines of the service's log, and changes of mode, arming and plan
  session TEXT NOT NULL,
  unix_s REAL NOT NULL,
  level TEXT NOT NULL,
  event TEXT NOT NULL,             -- vehicle_phase, show_phase, vehicle_mode, plan, cue, link_failed ...
  vehicle TEXT,
  detail TEXT NOT NULL             -- JSON
);
CREATE TABLE vehicles (            -- the last known of each; NULL: never known
  id TEXT PRIMARY KEY,
  session TEXT NOT NULL,           -- that wrote last
  unix_s REAL NOT NULL,
  system_id INTEGER NOT NULL,
  link TEXT NOT NULL,
  host TEXT,                       -- of its newest frame: an address and a port, or a serial port and 0
  port INTEGER,
  phase TEXT,
  reason TEXT,
  mode TEXT,
  armed INTEGER,
  home_x_m REAL,                   -- where it took off, in the show frame of the session's configuration
  home_y_m REAL,
  home_z_m REAL
) WITHOUT ROWID;
CREATE TABLE show (                -- the last known; one row
  one INTEGER PRIMARY KEY CHECK (one = 1),
  session TEXT NOT NULL,
  unix_s REAL NOT NULL,
  phase TEXT NOT NULL,
  reason TEXT NOT NULL,
  plan TEXT NOT NULL               -- formation, orbit, target, obstacles, yaw; JSON
);
