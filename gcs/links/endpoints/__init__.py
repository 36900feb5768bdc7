"""UDP, TCP and serial ports behind one protocol; knows frames, not messages."""

from gcs.links.endpoints.endpoint import Arrival, Endpoint
from gcs.links.endpoints.making import make
from gcs.links.endpoints.urls import Listen, Place, SerialPort, TcpIn, TcpOut, UdpOut, occupied, parse

__all__ = [
    "Arrival",
    "Endpoint",
    "Listen",
    "Place",
    "SerialPort",
    "TcpIn",
    "TcpOut",
    "UdpOut",
    "make",
    "occupied",
    "parse",
]
