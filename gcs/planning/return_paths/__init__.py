"""Paths home for the whole fleet without conflicts, planned before they are flown; pure.

`candidates` generates the paths that each vehicle may take, and `conflicts` selects path and time for each.
`planner` repeats that in rounds. `paths` is the plan, how it is followed, and when a vehicle descends.
`closed_ways` says which places and paths vehicles close that are lost.
"""
