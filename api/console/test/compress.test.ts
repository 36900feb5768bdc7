import { brotliDecompressSync, gunzipSync } from "node:zlib";
import { expect, test } from "vitest";

import { twins } from "../compress";

test("both twins hold the same bytes as the file, and are much smaller", () => {
  const content = Buffer.from(Array.from({ length: 2000 }, (_, k) => `const part${k} = "é${(k * 7919) % 97}";\n`).join(""));
  const made = twins(content);
  expect(brotliDecompressSync(made.get(".br")!).equals(content)).toBe(true);
  expect(gunzipSync(made.get(".gz")!).equals(content)).toBe(true);
  expect(made.get(".br")!.length).toBeLessThan(made.get(".gz")!.length);
  expect(made.get(".gz")!.length).toBeLessThan(0.3 * content.length);
});

test("what is small, or does not become smaller, has none", () => {
  expect(twins(Buffer.from("fly()")).size).toBe(0);
  let at = 1;
  const noise = Uint8Array.from({ length: 4000 }, () => (at = (at * 48271) % 2147483647) >> 8);
  expect(twins(noise).size).toBe(0);
});
