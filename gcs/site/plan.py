"""Changes of the plan of a site: any station asks for them, and the lead applies them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any, Final

from pydantic import TypeAdapter

from gcs.flight.commands.plan_editor import PlanEditor
from gcs.model.errors import GcsError, RefusedError
from gcs.model.plan import Formation, Obstacle, Orbit, Plan, Target, Yaw
from gcs.model.target_fix import TargetFix
from gcs.service import CALLER
from gcs.site.member import SiteMember
from gcs.site.requests import REQUEST, PlanRequest, Refusal

NAMED: Final[TypeAdapter[dict[str, str]]] = TypeAdapter(dict[str, str])
"""Changes that name something at most."""

VALUES: Final[Mapping[str, TypeAdapter[Any]]] = {
    "set_formation": TypeAdapter(Formation),
    "set_orbit": TypeAdapter(Orbit),
    "set_target": TypeAdapter(Target),
    "set_yaw": TypeAdapter(Yaw),
    "add_obstacle": TypeAdapter(Obstacle),
    "change_obstacle": TypeAdapter(Obstacle),
    "remove_obstacle": NAMED,
    "select_target": NAMED,
    "hold_target": NAMED,
}

PARTS: Final = {"set_formation": "formation", "set_orbit": "orbit", "set_yaw": "yaw"}
"""Parts of the plan of which single fields may be changed."""


@dataclass(eq=False)
class SitePlanEditor:
    """Changes the plan at the lead; a follower checks a change, and asks the lead for it.

    Implements `gcs.service.PlanChanges`.
    """

    local: PlanEditor
    member: SiteMember

    @property
    def current(self) -> Plan:
        return self.local.current

    def set_formation(self, formation: Formation, fields: Sequence[str] = ()) -> None:
        self._change("set_formation", formation, partial(self.local.set_formation, formation, fields), fields)

    def set_orbit(self, orbit: Orbit, fields: Sequence[str] = ()) -> None:
        self._change("set_orbit", orbit, partial(self.local.set_orbit, orbit, fields), fields)

    def set_target(self, target: Target) -> None:
        self._change("set_target", target, partial(self.local.set_target, target))

    def select_target(self, name: str) -> None:
        self._change("select_target", {"name": name}, partial(self.local.select_target, name))

    def hold_target(self) -> None:
        self._change("hold_target", {}, self.local.hold_target)

    def report_target(self, name: str, fix: TargetFix) -> None:
        if not self.member.site.lead.leads:
            raise RefusedError(f"report to the leading station, {self.member.site.lead.name}")
        self.local.report_target(name, fix)

    def set_yaw(self, yaw: Yaw, fields: Sequence[str] = ()) -> None:
        self._change("set_yaw", yaw, partial(self.local.set_yaw, yaw, fields), fields)

    def add_obstacle(self, obstacle: Obstacle) -> None:
        self._change("add_obstacle", obstacle, partial(self.local.add_obstacle, obstacle))

    def change_obstacle(self, obstacle: Obstacle) -> None:
        self._change("change_obstacle", obstacle, partial(self.local.change_obstacle, obstacle))

    def remove_obstacle(self, obstacle_id: str) -> None:
        self._change("remove_obstacle", {"id": obstacle_id}, partial(self.local.remove_obstacle, obstacle_id))

    def _change(self, name: Any, value: Any, apply: Callable[[], None], fields: Sequence[str] = ()) -> None:
        member = self.member
        if member.site.lead.leads:
            apply()
            return
        lead = member.site.lead.name
        if not member.lead_is_here:
            raise RefusedError(f"the leading station {lead} is not received: gcs lead take")
        apply()
        written = value if isinstance(value, dict) else asdict(value)
        if fields:
            written = {key: each for key, each in written.items() if key in fields}
        request = PlanRequest(member.note_change(), CALLER.get(), name, written)
        member.post(lead, REQUEST.dump_python(request, mode="json"))

    def change_for(self, station: str, request: PlanRequest) -> None:
        """Apply a change that a follower asks for: the fields that it names, the others stay.

        Both stations log a refusal, and the plan comes back to the follower.
        """
        try:
            given = dict(request.value)
            if request.change in PARTS:
                given = asdict(getattr(self.local.current, PARTS[request.change])) | given
            value = VALUES[request.change].validate_python(given)
            change = getattr(self.local, request.change)
            if VALUES[request.change] is NAMED:
                change(*value.values())
            else:
                change(value)
        except (GcsError, KeyError, ValueError) as refused:
            self.member.refuse(station, Refusal(request.change, request.by, str(refused)[:500]))
        self.member.sender.note_applied(station, request.number)
