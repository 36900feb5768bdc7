"""The types that every package uses: fleet arrays, plan, phases, errors; pure, imports no other package."""
