// glTF 2.0 binary: the document and its accessors as typed arrays.
const MAGIC = 0x46546c67;
const ARRAYS = { 5120: Int8Array, 5121: Uint8Array, 5122: Int16Array, 5123: Uint16Array, 5125: Uint32Array, 5126: Float32Array };
const COMPONENTS = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 };

/** `document`, and `read(accessor)`: its numbers, closely packed. */
export function parseGlb(buffer) {
  const view = new DataView(buffer);
  if (view.getUint32(0, true) !== MAGIC) throw new Error("not a glTF binary file");
  const jsonBytes = view.getUint32(12, true);
  const document = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 20, jsonBytes)));
  const binary = 20 + jsonBytes + 8;
  const read = (index) => {
    const { bufferView, byteOffset = 0, componentType, count, type } = document.accessors[index];
    const { byteOffset: start = 0, byteStride } = document.bufferViews[bufferView];
    const Type = ARRAYS[componentType];
    const width = COMPONENTS[type];
    const row = width * Type.BYTES_PER_ELEMENT;
    const at = binary + start + byteOffset;
    if (byteStride === undefined || byteStride === row) return new Type(buffer.slice(at, at + count * row));
    const packed = new Type(count * width);
    for (let k = 0; k < count; k += 1) {
      const from = at + k * byteStride;
      packed.set(new Type(buffer.slice(from, from + row)), k * width);
    }
    return packed;
  };
  return { document, read };
}
