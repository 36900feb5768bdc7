import { defineConfig } from "vitest/config";

import { compressed } from "./compress.ts";

// `npx vite` serves the page while one works on it, and asks a service on this machine for the rest.
export default defineConfig({
  base: "/",
  publicDir: false,
  plugins: [compressed()],
  build: {
    target: "es2022",
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    chunkSizeWarningLimit: 1900, // Swagger UI, which only /docs loads
    rolldownOptions: { input: ["index.html", "docs.html"] },
  },
  server: { proxy: { "/api": { target: "http://127.0.0.1:8000", ws: true } } },
  test: { include: ["test/**/*.test.ts"], environment: "node", isolate: false, testTimeout: 120_000 }, // machines are busy
});
