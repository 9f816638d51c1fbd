// Bundles src/ into ../built: page.js (a classic script, for modules do not load from file://), page.css, and the
// licences of what is inside. The first line of page.js has a digest of the sources; tests/pages/test_bundle.py
// computes it again without Node.
//   npm ci && npm run build
import { createHash } from "node:crypto";
import { existsSync, readFileSync, readdirSync, statSync, writeFileSync } from "node:fs";
import { dirname, join, relative, sep } from "node:path";
import { fileURLToPath } from "node:url";
import { build } from "esbuild";

const here = dirname(fileURLToPath(import.meta.url));
const out = join(here, "..", "built");

function filesBelow(folder) {
  return readdirSync(folder).flatMap((name) => {
    const path = join(folder, name);
    return statSync(path).isDirectory() ? filesBelow(path) : [path];
  });
}

function digest() {
  const named = ["build.mjs", "package.json", "package-lock.json"].map((name) => join(here, name));
  const paths = [...named, ...filesBelow(join(here, "src"))].map((path) => relative(here, path).split(sep).join("/"));
  const hash = createHash("sha256");
  for (const path of paths.sort()) hash.update(`${path}\0`).update(readFileSync(join(here, path))).update("\0");
  return hash.digest("hex");
}

function packageOf(input) {
  const parts = input.split("/");
  const at = parts.lastIndexOf("node_modules");
  if (at < 0) return null;
  const name = parts[at + 1].startsWith("@") ? parts.slice(at + 1, at + 3) : parts.slice(at + 1, at + 2);
  return [...parts.slice(0, at + 1), ...name].join("/");
}

function licences(inputs) {
  const folders = [...new Set(inputs.map(packageOf).filter(Boolean))].sort();
  const byText = new Map();
  for (const folder of folders) {
    const path = join(here, folder);
    const about = JSON.parse(readFileSync(join(path, "package.json"), "utf8"));
    const file = ["LICENSE", "LICENSE.md", "LICENSE.txt", "LICENCE", "license"].find((n) => existsSync(join(path, n)));
    // A package without a file says its licence in package.json alone.
    const text = file ? readFileSync(join(path, file), "utf8").trim() : `Licence: ${about.license}`;
    byText.set(text, [...(byText.get(text) ?? []), `${about.name} ${about.version} (${about.license ?? "see below"})`]);
  }
  const blocks = [...byText].map(([text, names]) => `${names.join("\n")}\n\n${text}\n`);
  return `What page.js holds besides the sources of detailbench (MIT):\n\n${blocks.join(`\n${"-".repeat(78)}\n\n`)}`;
}

const common = { bundle: true, minify: true, charset: "utf8", legalComments: "none", absWorkingDir: here };
const made = await build({
  ...common,
  entryPoints: ["src/main.js"],
  format: "iife",
  target: ["es2022"],
  metafile: true,
  write: false,
  define: { "process.env.NODE_ENV": '"production"' },
});
const styled = await build({ ...common, entryPoints: ["src/page.css"], write: false });
// A page holds the script between tags: no text in it may end them.
const script = made.outputFiles[0].text.replaceAll("</script", "<\\/script").replaceAll("<!--", "<\\!--");
writeFileSync(join(out, "page.js"), `/* detailbench pages, sources sha256:${digest()} */\n${script}`);
writeFileSync(join(out, "page.css"), styled.outputFiles[0].text);
writeFileSync(join(out, "LICENCES.txt"), licences(Object.keys(made.metafile.inputs)));
console.log(`page.js ${(script.length / 1024).toFixed(0)} kB, page.css ${(styled.outputFiles[0].text.length / 1024).toFixed(0)} kB`);
