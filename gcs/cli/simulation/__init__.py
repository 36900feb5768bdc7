"""`gcs simulate`: the tick that flies real vehicles, in virtual time, judged by the true states."""
