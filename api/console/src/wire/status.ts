// What the console's stream says seldom: its text messages.

import type { components } from "./schema";

export type Status = components["schemas"]["Status"];
