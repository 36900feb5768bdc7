"""UDP, TCP and serial ports behind one interface; knows frames, not messages."""
