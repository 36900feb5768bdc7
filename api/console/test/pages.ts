// Pages for tests: a state with every right and a service that answers, and panels whose presses change the state.

import { createActions, type Actions } from "../src/actions";
import type { Message } from "../src/messages";
import type { PanelActions } from "../src/panels/actions";
import { createDeskActions } from "../src/panels/createActions";
import type { Api } from "../src/connection/rest";
import { initial, type Access, type Right, type State } from "../src/state";
import { update } from "../src/update";

const ALL: readonly Right[] = ["watch", "operate", "emergency"];

export const access = (rights: readonly Right[] = ALL): Access => ({ name: "anna", rights: new Set(rights) });

export const live = (change: Partial<State> = {}): State => ({
  ...initial(0), connection: { kind: "live", since_ms: 0, reason: "" }, access: access(), ...change,
});

export const after = (messages: readonly Message[], state: State = initial(0)): State => messages.reduce(update, state);

export interface Panels {
  dispatch(message: Message): void;
  service: Actions;
  actions: PanelActions;
  state(): State;
}

/** What is pressed changes the state, as on the page. */
export function panelsOver(first: State, serviceOf: (dispatch: Panels["dispatch"], state: Panels["state"]) => Actions): Panels {
  let now = first;
  const state = (): State => now;
  const dispatch = (message: Message): void => void (now = update(now, message));
  const service = serviceOf(dispatch, state);
  return { dispatch, service, actions: createDeskActions(service, dispatch, state, () => undefined), state };
}

export interface Called {
  call: string;
  query: Record<string, unknown>;
  body: unknown;
}

/** Over an API whose calls are listed. Where `answer` has none, it refuses with these words. */
export function page(first: State, answer: (called: Called) => unknown, refusal: string): Panels & { calls: Called[] } {
  const calls: Called[] = [];
  type Options = { params?: { query?: Record<string, unknown> }; body?: unknown };
  const call = (method: string) => async (path: string, { params = {}, body }: Options = {}) => {
    const called = { call: `${method} ${path}`, query: params.query ?? {}, body };
    calls.push(called);
    const data = answer(called);
    const response = { ok: data !== undefined, status: data === undefined ? 422 : 200 };
    return data === undefined ? { error: { detail: refusal }, response } : { data, response };
  };
  const api = { GET: call("GET"), POST: call("POST"), PUT: call("PUT"), DELETE: call("DELETE") } as unknown as Api;
  return { calls, ...panelsOver(first, (dispatch, state) => createActions(api, dispatch, state)) };
}

export const settled = (): Promise<void> => new Promise((resolve) => setTimeout(resolve, 20));
