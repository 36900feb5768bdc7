"""Published methods of collision avoidance beside ours: `make race`, docs/race.md."""
