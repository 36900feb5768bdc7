// Map tiles and the show frame, pure. Tiles are web mercator's: columns from the west, rows from the north. Places are
// turned into the show's metres as the service does it: on WGS84, into the tangent plane at the show's origin.

const DEGREE = Math.PI / 180;
const EQUATOR_M = 6_378_137; // radius
const FLATTENING = 1 / 298.257_223_563;
const SQUASHED = FLATTENING * (2 - FLATTENING); // first eccentricity, squared
const NORTHMOST_DEG = 85.05; // of web mercator
const ROUNDS = 3; // towards the latitude of a place; 20 km away the third changes less than a millimetre

/** Pixels of a tile as it is shown, about: from 4/5 of that to 8/5. */
const SHOWN_PX = 256;
const FINE = 6; // tiles to a side, around where the camera looks
const COARSE = 5; // likewise, of those beneath them
const COARSER = 2; // zooms

export interface Origin {
  latitude_deg: number;
  longitude_deg: number;
  altitude_amsl_m: number;
  heading_deg: number;
}

export interface Place {
  latitude_deg: number;
  longitude_deg: number;
}

export interface Zooms {
  zoom_min: number;
  zoom_max: number;
}

/** The column may lie beyond the map's edge, where it wraps around. */
export interface Tile {
  zoom: number;
  column: number;
  row: number;
}

export interface Choice {
  /** In the order of loading: tiles that cover most first, then from the middle outwards. */
  tiles: readonly Tile[];
  /** So far around the middle all is covered. */
  reach_m: number;
}

/** Fractions are places within a tile. */
export function columnOf(longitude_deg: number, zoom: number): number {
  return (longitude_deg / 360 + 0.5) * 2 ** zoom;
}

export function rowOf(latitude_deg: number, zoom: number): number {
  return (0.5 - Math.asinh(Math.tan(latitude_deg * DEGREE)) / (2 * Math.PI)) * 2 ** zoom;
}

export function placeAt(column: number, row: number, zoom: number): Place {
  const count = 2 ** zoom;
  return {
    latitude_deg: Math.atan(Math.sinh(2 * Math.PI * (0.5 - row / count))) / DEGREE,
    longitude_deg: (column / count - 0.5) * 360,
  };
}

/** Earth-centred metres. */
function centred({ latitude_deg, longitude_deg }: Place, altitude_m: number): [number, number, number] {
  const [sp, cp] = [Math.sin(latitude_deg * DEGREE), Math.cos(latitude_deg * DEGREE)];
  const across_m = EQUATOR_M / Math.sqrt(1 - SQUASHED * sp * sp);
  const out_m = (across_m + altitude_m) * cp;
  const turn = longitude_deg * DEGREE;
  return [out_m * Math.cos(turn), out_m * Math.sin(turn), (across_m * (1 - SQUASHED) + altitude_m) * sp];
}

/** Where in the show frame a place at the origin's altitude is. */
export function toShowFrame(place: Place, origin: Origin): { x_m: number; y_m: number } {
  const here = centred(place, origin.altitude_amsl_m);
  const zero = centred(origin, origin.altitude_amsl_m);
  const [dx, dy, dz] = [here[0] - zero[0], here[1] - zero[1], here[2] - zero[2]];
  const [sp, cp] = [Math.sin(origin.latitude_deg * DEGREE), Math.cos(origin.latitude_deg * DEGREE)];
  const [sl, cl] = [Math.sin(origin.longitude_deg * DEGREE), Math.cos(origin.longitude_deg * DEGREE)];
  const north_m = -sp * (cl * dx + sl * dy) + cp * dz;
  const east_m = cl * dy - sl * dx;
  const [sh, ch] = [Math.sin(origin.heading_deg * DEGREE), Math.cos(origin.heading_deg * DEGREE)];
  return { x_m: ch * north_m + sh * east_m, y_m: ch * east_m - sh * north_m };
}

/** The place that is there. */
export function fromShowFrame(x_m: number, y_m: number, origin: Origin): Place {
  let place: Place = origin;
  for (let round = 0; round < ROUNDS; round += 1) {
    const found = toShowFrame(place, origin);
    const [ahead_m, right_m] = [x_m - found.x_m, y_m - found.y_m];
    const [sh, ch] = [Math.sin(origin.heading_deg * DEGREE), Math.cos(origin.heading_deg * DEGREE)];
    const [north_m, east_m] = [ch * ahead_m - sh * right_m, sh * ahead_m + ch * right_m];
    const [sp, cp] = [Math.sin(place.latitude_deg * DEGREE), Math.cos(place.latitude_deg * DEGREE)];
    const bent = 1 - SQUASHED * sp * sp;
    const along_m = (EQUATOR_M * (1 - SQUASHED)) / bent ** 1.5 + origin.altitude_amsl_m;
    const across_m = EQUATOR_M / Math.sqrt(bent) + origin.altitude_amsl_m;
    place = {
      latitude_deg: place.latitude_deg + north_m / along_m / DEGREE,
      longitude_deg: place.longitude_deg + east_m / (across_m * cp) / DEGREE,
    };
  }
  return place;
}

function tileWidth_m(latitude_deg: number, zoom: number): number {
  return (2 * Math.PI * EQUATOR_M * Math.cos(latitude_deg * DEGREE)) / 2 ** zoom;
}

/** The zoom at which a pixel of the map is about one of the screen. */
export function zoomFor(latitude_deg: number, pixel_m: number, { zoom_min, zoom_max }: Zooms): number {
  const desired = Math.floor(Math.log2(tileWidth_m(latitude_deg, 0) / (SHOWN_PX * pixel_m)) + 0.3);
  return Math.max(zoom_min, Math.min(zoom_max, desired));
}

/** A square of tiles, with a place as near to its middle as can be; those beyond the poles left out. */
function square({ latitude_deg, longitude_deg }: Place, zoom: number, side: number): Tile[] {
  const [column, row] = [columnOf(longitude_deg, zoom), rowOf(latitude_deg, zoom)];
  const [left, top] = [Math.round(column - side / 2), Math.round(row - side / 2)];
  const far = (tile: Tile): number => Math.hypot(tile.column + 0.5 - column, tile.row + 0.5 - row);
  return Array.from({ length: side * side }, (_, k) => ({ zoom, column: left + (k % side), row: top + Math.floor(k / side) }))
    .filter((tile) => tile.row >= 0 && tile.row < 2 ** zoom)
    .sort((a, b) => far(a) - far(b));
}

/** What to draw around a place of the show frame where a pixel shows `pixel_m`; nothing near the poles. */
export function choose(origin: Origin, x_m: number, y_m: number, pixel_m: number, zooms: Zooms): Choice {
  const middle = fromShowFrame(x_m, y_m, origin);
  if (!(Math.abs(middle.latitude_deg) < NORTHMOST_DEG)) {
    return { tiles: [], reach_m: 1 };
  }
  const fine = zoomFor(middle.latitude_deg, pixel_m, zooms);
  const coarse = fine - COARSER;
  const near = square(middle, fine, FINE);
  const reach = (zoom: number, side: number): number => (side / 2 - 0.5) * tileWidth_m(middle.latitude_deg, zoom);
  return coarse < zooms.zoom_min
    ? { tiles: near, reach_m: reach(fine, FINE) }
    : { tiles: [...square(middle, coarse, COARSE), ...near], reach_m: reach(coarse, COARSE) };
}

/** The address of a tile; columns wrap around at the map's edge. */
export function addressOf({ zoom, column, row }: Tile, template: string): string {
  const count = 2 ** zoom;
  const values: Record<string, number> = { z: zoom, x: ((column % count) + count) % count, y: row };
  return template.replace(/\{([zxy])\}/g, (_, name: string) => String(values[name]));
}
