"""Who may call: tokens, rights, rate limits, the size of bodies, audit; stands before every route."""
