// Compressed twins of what is built, made once: `name.br` and `name.gz` beside each file that becomes smaller by it.

import { writeFile } from "node:fs/promises";
import { join } from "node:path";
import { brotliCompressSync, constants, gzipSync } from "node:zlib";

const LEAST_BYTES = 512; // what is smaller fits one packet as it is
const WORTH = 0.9; // of its size; pictures are compressed already

/** The twins of a file by the ending of their names; those that are not worth it are left out. Pure. */
export function twins(content: Uint8Array): ReadonlyMap<".br" | ".gz", Uint8Array> {
  if (content.length < LEAST_BYTES) return new Map();
  const parameters = { [constants.BROTLI_PARAM_QUALITY]: constants.BROTLI_MAX_QUALITY, [constants.BROTLI_PARAM_SIZE_HINT]: content.length };
  const all = [
    [".br", brotliCompressSync(content, { params: parameters })],
    [".gz", gzipSync(content, { level: 9 })],
  ] as const;
  return new Map(all.filter(([, packed]) => packed.length < WORTH * content.length));
}

/** For Vite: after the build every file that was written gets its twins. */
export function compressed(): {
  name: string;
  apply: "build";
  writeBundle(
    options: { dir?: string | undefined },
    bundle: Readonly<Record<string, { type: "chunk"; code: string } | { type: "asset"; source: string | Uint8Array }>>,
  ): Promise<void>;
} {
  return {
    name: "compressed",
    apply: "build",
    async writeBundle({ dir }, bundle) {
      if (dir === undefined) throw new Error("the build has no folder to write to");
      for (const [name, file] of Object.entries(bundle)) {
        const content = Buffer.from(file.type === "chunk" ? file.code : file.source);
        for (const [ending, packed] of twins(content)) await writeFile(join(dir, name + ending), packed);
      }
    },
  };
}
