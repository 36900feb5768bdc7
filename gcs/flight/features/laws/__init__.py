"""Laws of other packages: each has a process of its own, and is relied on while it keeps bounds."""
