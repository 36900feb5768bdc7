"""Conditions that an operator must know, most severe first; pure (decision 0023).

Sources report regularly which `Condition`s hold; the `AlarmBook` turns them into `Alarm`s. To add a cause:

1. add a member to `AlarmCause` and its row to `CAUSES` (severity, headline, advice) in
   `gcs.service.alarms.causes`;
2. add its row to the table in docs/operations.md (a test compares the two);
3. yield a `Condition` while the cause holds, from `gcs.flight.alarm_monitor` or from one of its sources. Pass
   a value at a limit through `gcs.service.alarms.limits` first, so that it does not flicker.
"""

from gcs.service.alarms.book import AlarmBook, Change, ChangeKind
from gcs.service.alarms.causes import CAUSES, AlarmCause, AlarmSeverity, CauseRow
from gcs.service.alarms.limits import Limit, beyond
from gcs.service.alarms.model import RANK, Alarm, Condition, OverallSeverity, ordered, overall

__all__ = [
    "CAUSES",
    "RANK",
    "Alarm",
    "AlarmBook",
    "AlarmCause",
    "AlarmSeverity",
    "CauseRow",
    "Change",
    "ChangeKind",
    "Condition",
    "Limit",
    "OverallSeverity",
    "beyond",
    "ordered",
    "overall",
]
