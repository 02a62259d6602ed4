// What the page fetches of a mission, taken from the page itself: it stands in for server.js where one file plays a
// mission without a server. Each file is an element <script type="application/gzip" data-file="PATH"> in base64.

export class CancelledError extends Error {}

export async function fetchBytes(path) {
  const held = document.querySelector(`script[data-file="${path}"]`);
  if (!held) throw new Error(`This page has no ${path}.`);
  const packed = Uint8Array.from(atob(held.textContent.trim()), letter => letter.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream('gzip'))).arrayBuffer();
}

export async function fetchJson(path) {
  return JSON.parse(new TextDecoder().decode(await fetchBytes(path)));
}
