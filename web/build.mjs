// Bundles the pages' scripts into the package: each is one file that needs no network.
import { build } from "esbuild";

await build({
  entryPoints: { visibility: "src/visibility_page.js", visibility_widget: "src/visibility_widget.js", walk: "src/walk_page.js" },
  outdir: "../python/cyclorama/pages",
  bundle: true,
  minify: true,
  format: "esm",
  target: "es2022",
  legalComments: "eof",
});
