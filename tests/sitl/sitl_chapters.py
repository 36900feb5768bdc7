"""What is flown: chapters, each a function of an operator's commands, and stories made of them.

A chapter raises GcsError or ServiceError when what must be true afterwards is not, and CannotError when these
simulators cannot do what it needs, which the verdict names. A new chapter is a function, and its name in a
story. Each sortie of a story begins and ends on the ground; `fly` brings it home.
"""

import time
from collections.abc import Callable, Sequence
from itertools import cycle
from typing import TypeAlias

import numpy as np

from gcs.model.errors import GcsError
from gcs.model.plan import Obstacle
from gcs.shows.formats import write_drawing
from tests.sitl.sitl_flight import SitlFlight
from tests.sitl.sitl_service import ServiceError
from tests.sitl.sitl_simulators import CannotError
from tests.support.drawn_shows import drawn_show

Chapter: TypeAlias = Callable[[SitlFlight], None]
Story: TypeAlias = Sequence[Sequence[Chapter]]

STALL_S = 4.0
STALLS_S = (1.0, 2.0, 4.0, 10.0)
NAMED_WITHIN_S = 15.0
"""PX4 holds for COM_FAIL_ACT_T, 5 s, before most of its failsafes."""

AHEAD_M = 32.0
"""Of the centre: far enough for the vehicles in front to stop before the mast."""

DRAWN_S, DRAWN_SPACING_M, CHECKED_S = 60.0, 3.5, 180.0


def assembled(flight: SitlFlight) -> None:
    """Start; every vehicle must be in the formation."""
    flight.started()
    _in_formation(flight)
    flight.judge_steady(f"assembled_{len(flight.account.flown)}" if flight.account.steady else "assembled")


def started_under_stall(flight: SitlFlight) -> None:
    """The station stalls while vehicles climb."""
    flight.started()
    flight.until("a vehicle climbs", flight.pace.up_s, lambda: _any_phase(flight, "takeoff"))
    flight.service.stop_for(2.0)
    flight.say("the service was stopped for 2 s: while vehicles climb")
    flight.settle(flight.alive)


def radius(flight: SitlFlight) -> None:
    """Two thirds of the radius."""
    radius_m = 2.0 / 3.0 * flight.client.formation().radius_m
    flight.client.change_formation(radius_m=radius_m)
    flight.say(f"radius {radius_m:g} m")
    flight.until("the new radius", flight.pace.formed_s, flight.radius_reached)
    flight.judge_steady("radius")


def law_slots(flight: SitlFlight) -> None:
    """Start under the law of the configurations."""
    _under(flight, "slots")


def law_article(flight: SitlFlight) -> None:
    """Start under the law as the article prints it."""
    _under(flight, "article")


def law_neighbours(flight: SitlFlight) -> None:
    """Start under the law that knows the neighbours only."""
    _under(flight, "neighbours")


def _under(flight: SitlFlight, law: str) -> None:
    """Choose the law, which only the ground allows, start, and judge the shape."""
    flight.client.change_formation(law=law)
    flight.say(f"law {law}")
    flight.started()
    _in_formation(flight)
    time.sleep(flight.pace.steady_s)  # the article's law takes longer to its shape
    flight.judge_steady(f"law_{law}")


def orbit(flight: SitlFlight) -> None:
    """An orbit around a target that moves."""
    flight.client.change_orbit(radius_m=12.0, speed_m_s=2.0)
    _move_target(flight)
    flight.say("orbit of 12 m around a target that moves at 0.6 m/s")
    time.sleep(flight.pace.orbit_s)


def obstacle(flight: SitlFlight) -> None:
    """A mast in the formation's way."""
    center = flight.client.fleet().center
    if center is None or center.vx_m_s is None:
        raise ServiceError("no formation flies")
    course = np.array([center.vx_m_s, center.vy_m_s], dtype=np.float64)
    course /= max(float(np.linalg.norm(course)), 1e-3)
    here_m = np.array([center.x_m, center.y_m], dtype=np.float64)
    x_m, y_m = (here_m + AHEAD_M * course).round(1).tolist()
    box = Obstacle("mast", x_m, y_m, 1.5, 1.5, 45.0)
    flight.client.add_obstacle(
        x_m=x_m,
        y_m=y_m,
        half_length_x_m=box.half_length_x_m,
        half_length_y_m=box.half_length_y_m,
        height_m=box.height_m,
        obstacle_id=box.id,
    )
    flight.account.obstacle, flight.account.obstacle_s = box, (time.monotonic(), np.inf)
    flight.say(f"a mast stands at ({x_m:g}, {y_m:g}) m")
    time.sleep(flight.pace.orbit_s)


def paused(flight: SitlFlight) -> None:
    """Pause and resume."""
    flight.client.pause()
    flight.reach("paused", 10.0)
    time.sleep(3.0)
    flight.client.resume()
    flight.reach("running", flight.pace.formed_s)
    flight.say("paused and resumed")


def vehicle_killed(flight: SitlFlight) -> None:
    """SIGKILL of one instance: the formation closes the gap."""
    name = flight.victim
    flight.client.change_orbit(radius_m=0.0)
    flight.simulators.kill(flight.index(name))
    flight.account.lost.append(name)
    flight.say(f"{name}: SIGKILL")
    flight.until(f"{name} lost", 20.0, lambda: flight.client.vehicle(name).phase == "lost")
    flight.reach("running", flight.pace.formed_s)
    time.sleep(flight.pace.steady_s)  # the formation closes the gap
    flight.judge_steady("after_loss")


def vehicle_restarted(flight: SitlFlight) -> None:
    """On the ground: the instance that was killed starts again, on its pad, and is ready to fly."""
    name = flight.victim
    if name not in flight.account.lost:
        return
    if flight.client.vehicle(name).phase == "lost":  # not where the service was started anew since
        flight.client.command(name, "confirm-down")
    flight.simulators.restart(flight.index(name))
    flight.account.lost.remove(name)
    flight.say(f"{name}: started again")
    flight.until("every vehicle ready", flight.pace.ready_s, flight.all_ready)


def stall(flight: SitlFlight) -> None:
    """SIGSTOP of the service."""
    flight.stall("in formation", STALL_S)


def stalls(flight: SitlFlight) -> None:
    """SIGSTOP of the service for 1 to 10 s, while the formation does what it can do."""
    client = flight.client
    start_m = client.formation().radius_m, client.formation().height_m
    changes: dict[str, Callable[[], object]] = {
        "at rest": lambda: None,
        "while the radius changes": lambda: client.change_formation(radius_m=0.75 * start_m[0]),
        "in orbit": lambda: client.change_orbit(radius_m=12.0, speed_m_s=2.5),
        "behind a moving target": lambda: _move_target(flight),
        "while the height changes": lambda: client.change_formation(height_m=start_m[1] + 5.0),
        "on the way back": lambda: (
            client.change_orbit(radius_m=0.0),
            client.change_formation(radius_m=start_m[0], height_m=start_m[1]),
        ),
        "paused": client.pause,
    }
    for (when, change), seconds in zip(changes.items(), cycle(STALLS_S), strict=False):
        change()
        time.sleep(3.0)
        flight.stall(when, seconds)
    time.sleep(flight.pace.steady_s)


def returned_under_stall(flight: SitlFlight) -> None:
    """The station stalls while all fly home; one more `stop` brings them down."""
    flight.accept("stop", flight.client.stop)
    flight.reach("returning", 10.0)
    time.sleep(4.0)
    flight.service.stop_for(STALL_S)
    flight.say(f"the service was stopped for {STALL_S:g} s: on the way home")
    time.sleep(1.0)
    if flight.client.show().phase != "landed":
        flight.accept("stop", flight.client.stop)
    flight.reach("landed", flight.pace.home_s)


def service_killed(flight: SitlFlight) -> None:
    """SIGKILL of the service, and a new one that finds the fleet in the air."""
    flying = flight.flying()
    flight.service.kill()
    killed_s = time.monotonic()
    flight.service.start()
    flight.say("the service was killed and started again")
    flight.until("telemetry of the interrupted flight", 60.0, lambda: flying <= _waiting(flight))
    flight.accept("take-over", flight.client.take_over)
    formed = flight.pace.formed_s
    flight.until("control of the whole fleet", formed, lambda: flight.flying() == flying)
    flight.account.recovered_after_restart_s = time.monotonic() - killed_s


def lead_killed(flight: SitlFlight) -> None:
    """SIGKILL of the station that leads, and a new one; the vehicles of the other fly on."""
    stations = flight.service.stations
    if len(stations) < 2:
        raise CannotError("one station flies all vehicles: STATIONS=2")
    fleet = flight.client.fleet()
    others = {each.id for each in fleet.vehicles if each.station == stations[1]} & flight.alive
    everything = flight.flying()
    flight.service.kill(stations[0])
    killed_s = time.monotonic()
    flight.say(f"station {stations[0]} was killed")
    time.sleep(5.0)
    if others & everything != others & flight.flying():
        raise ServiceError(f"not all of {sorted(others)} flew on without the lead")
    flight.service.start()
    flight.settle(everything)
    flight.account.recovered_after_restart_s = time.monotonic() - killed_s


def estimator_reset(flight: SitlFlight) -> None:
    """One vehicle's position jumps by a metre, once: it must stay in the formation."""
    name, before = flight.ids[-2], flight.flying()
    flight.inject("estimator-reset", name)
    time.sleep(flight.pace.steady_s)
    if name not in flight.flying():
        vehicle = flight.client.vehicle(name)
        raise ServiceError(f"{name} left the formation after one reset: {vehicle.phase}, {vehicle.reason}")
    flight.settle(before)


def gps_lost(flight: SitlFlight) -> None:
    """One vehicle loses its position: an alarm names it, and the others fly on."""
    _falls_out(flight, flight.ids[0], "gps-lost")


def battery_low(flight: SitlFlight) -> None:
    """One vehicle's battery is nearly empty: an alarm names it, and the others fly on."""
    _falls_out(flight, flight.ids[1], "battery-low")


def drawn(flight: SitlFlight) -> None:
    """A drawn show from the vehicles' own pads, as another program writes it: imported, checked, flown."""
    client, count = flight.client, len(flight.alive)
    if flight.account.lost:
        raise CannotError(f"{', '.join(flight.account.lost)} does not fly")
    pads_m = flight.simulators.pads.ned_m()
    file = flight.service.folder / "drawn.skyc"
    write_drawing(drawn_show(count, DRAWN_S, DRAWN_SPACING_M, seed=1, ground_m=pads_m), file)
    client.shows.import_drawing("drawn", file)
    client.shows.place("drawn", fit=True)
    client.shows.check("drawn")
    check = client.shows.wait_for_check("drawn", CHECKED_S)
    if not check.good or check.hash is None:
        raise ServiceError(f"the drawn show's check: {check.reason} {check.problems}")
    client.shows.select("drawn", check.hash)
    flight.until("every vehicle ready", flight.pace.ready_s, flight.all_ready)
    flight.accept("start", lambda: client.start(show_hash=check.hash))
    flight.say(f"a drawn show of {DRAWN_S:g} s")
    flight.reach("running", flight.pace.up_s + flight.pace.formed_s)
    flight.reach("landed", DRAWN_S + flight.pace.home_s)
    client.shows.deselect()


STORIES: dict[str, Story] = {
    "short": [[assembled]],
    "whole": [[assembled, radius, orbit, obstacle, paused, vehicle_killed, stall, service_killed]],
    "long": [
        [assembled, radius, orbit, obstacle, paused, vehicle_killed, stall, service_killed],
        [vehicle_restarted, started_under_stall, stalls, estimator_reset, returned_under_stall],
        [law_article],
        [law_neighbours],
        [drawn],  # after the restart: it may exchange pads, and a restarted instance stands on its own
        [law_slots, gps_lost, battery_low],
    ],
}
TWO_STATIONS: Story = [[assembled, radius, lead_killed]]


def fly(flight: SitlFlight, story: Story) -> None:
    """Every sortie, until a chapter fails; each comes home also then."""
    for sortie in story:
        failed = not all(_flown(flight, chapter) for chapter in sortie)
        try:
            flight.come_home()
            _repair(flight)
        except (GcsError, ServiceError) as error:
            flight.account.failures.append(f"home: {error}")
            return
        if failed:
            return


def _flown(flight: SitlFlight, chapter: Chapter) -> bool:
    """Fly one chapter. Returns: whether the sortie can go on."""
    name = chapter.__name__
    try:
        chapter(flight)
    except CannotError as error:
        flight.account.not_flown[name] = str(error)
        flight.say(f"{name}: not flown, {error}")
    except (GcsError, ServiceError) as error:
        flight.account.failures.append(f"{name}: {error}")
        flight.say(f"{name}: {error}")
        return False
    else:
        flight.account.flown.append(name)
    return True


def _repair(flight: SitlFlight) -> None:
    """What went wrong in vehicles on purpose is mended, before the next sortie."""
    account = flight.account
    account.obstacle_s = (account.obstacle_s[0], min(account.obstacle_s[1], time.monotonic()))
    for each in flight.client.obstacles():
        flight.client.remove_obstacle(each.id)
    for chapter, fault, name in (
        (gps_lost, "gps-back", flight.ids[0]),
        (battery_low, "battery-full", flight.ids[1]),
    ):
        if chapter.__name__ in account.flown:
            flight.inject(fault, name)


def _in_formation(flight: SitlFlight) -> None:
    """Wait for the whole formation. Raises: ServiceError, with the refusal of a start that was refused."""
    seconds = flight.pace.up_s + flight.pace.formed_s

    def formed() -> bool:
        show = flight.client.show()
        if show.phase == "idle" and show.reason != flight.reason_before:
            flight.account.refused.append(f"start: {show.reason}")
            raise ServiceError(f"the start was refused: {show.reason}")
        return show.phase == "running" and flight.alive <= flight.flying()

    flight.until("every vehicle in the formation", seconds, formed)


def _falls_out(flight: SitlFlight, name: str, fault: str) -> None:
    """Let a vehicle fail. It must be named, leave the formation and land; the others must fly on."""
    others = flight.flying() - {name}
    if len(others) < 2:
        raise CannotError("fewer than two vehicles would go on: VEHICLES=6")
    flight.inject(fault, name)
    flight.until(f"an alarm that names {name}", NAMED_WITHIN_S, lambda: bool(flight.alarms(name)))
    flight.say("; ".join(flight.alarms(name)))
    flight.until(f"{name} out of the formation", 60.0, lambda: name not in flight.flying())
    flight.settle(others)
    flight.say("; ".join(flight.alarms(name)))


def _move_target(flight: SitlFlight) -> None:
    target = flight.client.target()
    flight.client.set_target(target.x_m or 0.0, target.y_m or 0.0, velocity_x_m_s=0.5, velocity_y_m_s=-0.3)


def _any_phase(flight: SitlFlight, phase: str) -> bool:
    return any(each.phase == phase for each in flight.client.vehicles())


def _waiting(flight: SitlFlight) -> set[str]:
    """Vehicles of an interrupted flight that wait for take-over, where it is offered."""
    found = flight.client.interrupted()
    if found is None or "take-over" not in found.offers:
        return set()
    return {name for name, vehicle in found.vehicles.items() if vehicle.waits}
