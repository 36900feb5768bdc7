// Calls of the REST API, typed by its OpenAPI. What is refused comes back as the service's own words.

import createClient, { type Client } from "openapi-fetch";

import { texts } from "../texts";
import type { components } from "../schemas/schema";

type Paths = components["schemas"]["Paths"];

export type Api = Client<Paths>;

/** A call: done with what it answered, or refused and why. */
export type Outcome<T> = { ok: true; data: T } | { ok: false; status: number; reason: string };

export function createApi(token: () => string): Api {
  const api = createClient<Paths>({ baseUrl: location.origin });
  api.use({
    onRequest({ request }) {
      if (token() !== "") request.headers.set("Authorization", `Bearer ${token()}`);
      return request;
    },
  });
  return api;
}

/** Wait for a call. Never throws for what a service or a network can do. */
export async function outcome<T>(call: Promise<{ data?: T; error?: unknown; response: Response }>): Promise<Outcome<T>> {
  try {
    const { data, error, response } = await call;
    if (response.ok) return { ok: true, data: data as T };
    return { ok: false, status: response.status, reason: reasonOf(error, response.status) };
  } catch (error) {
    if (error instanceof TypeError || error instanceof SyntaxError) {
      return { ok: false, status: 0, reason: texts.unreachable };
    }
    throw error;
  }
}

function reasonOf(error: unknown, status: number): string {
  const detail = typeof error === "object" && error !== null ? (error as { detail?: unknown }).detail : null;
  return typeof detail === "string" && detail !== "" ? detail : texts.noWords(status);
}
