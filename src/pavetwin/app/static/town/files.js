// Files of a town: fetched, unpacked and read.
import { ClampToEdgeWrapping, DataArrayTexture, GLTFLoader, LinearFilter, LinearMipmapLinearFilter, RepeatWrapping,
  SRGBColorSpace, Texture } from "../vendor.js";

const loader = new GLTFLoader();
// Pictures are decoded from their bytes: the loader itself would fetch them from a blob, which a strict
// Content-Security-Policy refuses.
loader.register((parser) => ({
  name: "pictures",
  loadTexture: async (index) => {
    const image = parser.json.images[parser.json.textures[index].source];
    const bytes = await parser.getDependency("bufferView", image.bufferView);
    return textureOf(await createImageBitmap(new Blob([bytes], { type: image.mimeType })));
  },
}));

function textureOf(bitmap) {
  const texture = new Texture(bitmap);
  texture.colorSpace = SRGBColorSpace;
  texture.wrapS = texture.wrapT = ClampToEdgeWrapping;
  texture.flipY = false;
  texture.anisotropy = 4;
  texture.needsUpdate = true;
  return texture;
}

export class Files {
  constructor(base, fetch) {
    this.base = base;
    this.fetch = fetch;
    this.bytes = 0;
  }

  // The bytes of a file; gzipped ones are unpacked unless the browser has done it.
  async read(name, signal) {
    const answer = await this.fetch(this.base + name, { signal });
    if (!answer.ok) throw new Error(`${name}: ${answer.status}`);
    const raw = await answer.arrayBuffer();
    this.bytes += raw.byteLength;
    const [first, second] = new Uint8Array(raw, 0, 2);
    if (first !== 0x1f || second !== 0x8b) return raw;
    return new Response(new Blob([raw]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
  }

  async json(name) {
    return JSON.parse(new TextDecoder().decode(await this.read(name)));
  }

  // The nodes with a mesh of a file by name, and what its asset says.
  async meshes(name, signal) {
    const file = await loader.parseAsync(await this.read(name, signal), "");
    const nodes = new Map();
    for (const child of file.scene.children) if (child.isMesh) nodes.set(child.userData.name ?? child.name, child);
    return { nodes, extras: file.asset.extras };
  }

  async texture(name) {
    return textureOf(await createImageBitmap(new Blob([await this.read(name)])));
  }

  // Square pictures below each other as the layers of one repeating texture.
  async layers(name) {
    const bitmap = await createImageBitmap(new Blob([await this.read(name)]));
    const side = bitmap.width, count = bitmap.height / side;
    const canvas = new OffscreenCanvas(side, bitmap.height);
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.drawImage(bitmap, 0, 0);
    const pixels = context.getImageData(0, 0, side, bitmap.height).data;
    const texture = new DataArrayTexture(new Uint8Array(pixels.buffer), side, side, count);
    texture.colorSpace = SRGBColorSpace;
    texture.wrapS = texture.wrapT = RepeatWrapping;
    texture.magFilter = LinearFilter;
    texture.minFilter = LinearMipmapLinearFilter;
    texture.generateMipmaps = true;
    texture.anisotropy = 4;
    texture.needsUpdate = true;
    return texture;
  }
}
