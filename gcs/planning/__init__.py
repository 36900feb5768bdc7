"""Feasibility, loss of control, landing sites, return paths; pure, imports control and what lies below."""
