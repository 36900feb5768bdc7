"""The service port between two processes: control answers, the API's process asks.

They share one pair of Unix sockets, which nothing else can reach. Requests are data, checked against the
closed table of `messages`, because the process that sends them reads what strangers send. Answers are
pickles: the API's process trusts control. See docs/decisions/processes.md.
"""

from gcs.service.remote.client import RemoteService as RemoteService
from gcs.service.remote.server import PortServer as PortServer
