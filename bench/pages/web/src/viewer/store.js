// Where the page keeps packed shapes: in itself, or in files beside it that are loaded when they are wanted.
//
//   <script type="text/plain" id="geometry-ID">BASE64</script>      in a page of one file
//   geometry/ID.js: detailbenchGeometry["ID"] = "BASE64"            in a site; detailbenchGeometryFolder names the folder

import { bytesOf, unpack } from "./decode.js";

const shapes = new Map();
// Found when this script starts: the page may put something else in the place of its body.
const elements = new Map(
  [...document.querySelectorAll('script[type="text/plain"][id^="geometry-"]')].map((element) => [element.id.slice(9), element]),
);

/** The shape of an ID, unpacked once however many panels show it. */
export function shapeOf(id) {
  if (!shapes.has(id)) {
    const found = text(id).then((base64) => unpack(bytesOf(base64)));
    found.catch(() => shapes.delete(id));
    shapes.set(id, found);
  }
  return shapes.get(id);
}

/** The address of a picture that lies where shapes do. */
export async function pictureOf(id) {
  return `data:image/webp;base64,${await text(id)}`;
}

/** Drop all unpacked shapes but those that are named. */
export function keepOnly(ids) {
  for (const id of shapes.keys()) if (!ids.has(id)) shapes.delete(id);
}

async function text(id) {
  const element = elements.get(id) ?? document.getElementById(`geometry-${id}`);
  if (element) return element.textContent;
  const stored = (globalThis.detailbenchGeometry ??= {});
  if (!(id in stored)) await loaded(`${globalThis.detailbenchGeometryFolder ?? "geometry/"}${encodeURIComponent(id)}.js`);
  if (!(id in stored)) throw new Error("The shape is not in this page.");
  return stored[id];
}

function loaded(source) {
  return new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = source;
    script.onload = () => resolve(script.remove());
    script.onerror = () => {
      script.remove();
      reject(new Error(`The file ${source} beside this page cannot be read.`));
    };
    document.head.append(script);
  });
}
