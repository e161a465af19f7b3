// SPDX-License-Identifier: Apache-2.0
import { basename } from "node:path";
import react from "@vitejs/plugin-react";
import { defineConfig } from "vite";

// The names have no hashes, so that a change of one file is a change of one file in the package.
export default defineConfig({
  plugins: [react()],
  css: {
    modules: {
      // Such as "outline-node" for the class "node" in outline.module.css; "outline" for the class "outline".
      generateScopedName: (name, file) => {
        const module = basename(file).replace(/\.module\.css.*$/, "");
        return module === name ? name : `${module}-${name}`;
      },
    },
  },
  build: {
    outDir: "../bt_agents_studio/page",
    emptyOutDir: true,
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    rollupOptions: {
      // Two documents, so that a tablet with the page Person loads no tree and no plots.
      input: { studio: "index.html", person: "person.html" },
      output: {
        entryFileNames: "[name].js",
        chunkFileNames: "[name].js",
        assetFileNames: "[name][extname]",
        codeSplitting: { groups: [{ name: "react", test: /node_modules\/(react|react-dom|scheduler)\// }] },
      },
    },
  },
});
