// Presses controls of a view without a document: finds a template's control by its test id, and calls its listener.

import type { TemplateResult } from "lit-html";

const MARK = "\u0000";

/** The template's text; what is no text stands as a mark around its number. */
function flat(value: unknown, others: unknown[]): string {
  if (typeof value === "string" || typeof value === "number") return String(value);
  if (Array.isArray(value)) return value.map((each) => flat(each, others)).join("");
  const { strings, values } = (value ?? {}) as Partial<TemplateResult>;
  if (strings === undefined && values?.length === 2 && typeof values[1] === "function") return flat(values[1](), others); // guard()
  if (strings !== undefined && values !== undefined) {
    return strings.map((text, i) => text + (i < values.length ? flat(values[i], others) : "")).join("");
  }
  return `${MARK}${others.push(value) - 1}${MARK}`;
}

/** All text of a view, tags included. */
export const textOf = (view: unknown): string => flat(view, []);

/** Call the listener of an event of the control with this test id. Throws: Error where there is none. */
export function press(view: unknown, testId: string, event: "click" | "input" | "change" | "keydown" = "click", target: object = {}, key = ""): void {
  const others: unknown[] = [];
  const tag = flat(view, others).match(/<[a-z]+[^>]*>/g)?.find((each) => new RegExp(`data-testid="?${testId}["\\s>]`).test(each));
  const listener = others[Number(tag?.split(`@${event}=${MARK}`)[1]?.split(MARK)[0])];
  if (typeof listener !== "function") throw new Error(`nothing to press: ${testId}`);
  (listener as (event: unknown) => void)({ target, key, preventDefault: () => undefined });
}
