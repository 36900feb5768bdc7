"""Who may call: tokens, rights, rate limits, audit; stands before every route."""
