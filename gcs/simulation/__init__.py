"""Virtual time: scenarios, metrics, show rehearsal; imports the control tick and sim's vehicle model."""
