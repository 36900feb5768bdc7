// Pictures of the map: of this service, with the token, or of the server that its configuration names, without.

import { texts } from "../texts";

const PATIENCE_MS = 15_000;
const WIDEST_PX = 2048;

export class TileError extends Error {
  /** There is none: the map ends there. */
  readonly isMissing: boolean;

  constructor(reason: string, isMissing: boolean) {
    super(reason);
    this.isMissing = isMissing;
  }
}

export type LoadTile = (address: string) => Promise<ImageBitmap>;

/** How to request a tile. Only this service gets the token, and redirects are not followed; map servers require the page's origin. */
export function requestFor(address: string, page: string, token: string): { url: string; init: RequestInit } {
  const url = new URL(address, page);
  const isOurs = address.startsWith("/") && url.origin === new URL(page).origin;
  const headers: Record<string, string> = isOurs && token !== "" ? { Authorization: `Bearer ${token}` } : {};
  const init: RequestInit = { headers, credentials: "omit", redirect: "error", referrerPolicy: "origin" };
  return { url: url.href, init };
}

/** The promises reject with TileError alone. */
export function createTiles(token: () => string): LoadTile {
  return async (address) => {
    try {
      const { url, init } = requestFor(address, location.origin, token());
      const response = await fetch(url, { ...init, signal: AbortSignal.timeout(PATIENCE_MS) });
      if (!response.ok) throw new TileError(texts.scene.mapStatus(response.status), response.status === 404);
      const picture = await createImageBitmap(await response.blob(), { premultiplyAlpha: "none" });
      if (Math.max(picture.width, picture.height) > WIDEST_PX) {
        picture.close();
        throw new TileError(texts.scene.mapUnreadable, false);
      }
      return picture;
    } catch (error) {
      if (error instanceof TypeError) throw new TileError(texts.scene.mapUnreachable, false);
      if (error instanceof DOMException) {
        throw new TileError(error.name === "TimeoutError" ? texts.scene.mapUnreachable : texts.scene.mapUnreadable, false);
      }
      throw error;
    }
  };
}
