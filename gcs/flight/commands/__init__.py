"""Commands of operators and failsafes, changes of the plan, and what follows an interruption."""
