/**
 * An ONNX file as bytes, as far as the runtime of browsers wants it changed.
 *
 * It feeds no input that has a default: those are initializers of the same name. Without the
 * initializer the same graph has the input as one that must be given.
 */

const MODEL_GRAPH = 7;
const GRAPH_INITIALIZER = 5;
const TENSOR_NAME = 8;
const LENGTH_DELIMITED = 2;

/**
 * The file with the default of one input taken out; the file itself where it has none.
 * @param {Uint8Array} bytes
 * @param {string} name of the input
 * @returns {Uint8Array}
 */
export function withoutDefault(bytes, name) {
  const graph = fieldsOf(bytes, 0, bytes.length).find(({ number }) => number === MODEL_GRAPH);
  if (!graph) return bytes;
  const isDefault = ({ number, start, end }) =>
    number === GRAPH_INITIALIZER && nameOf(bytes, start, end) === name;
  const given = fieldsOf(bytes, graph.start, graph.end).find(isDefault);
  if (!given) return bytes;
  const length = graph.end - graph.start - (given.end - given.begin);
  return concatenated([
    bytes.subarray(0, graph.begin),
    Uint8Array.of((MODEL_GRAPH << 3) | LENGTH_DELIMITED, ...varint(length)),
    bytes.subarray(graph.start, given.begin),
    bytes.subarray(given.end),
  ]);
}

/** The fields of a protobuf message: their number, where they begin, and where their content lies. */
function fieldsOf(bytes, from, to) {
  const fields = [];
  for (let at = from; at < to; ) {
    const tag = readVarint(bytes, at);
    const { start, end } = contentOf(bytes, tag.value & 7, tag.end);
    if (end > to) throw new RangeError("protobuf: a field is longer than its message");
    fields.push({ number: tag.value >>> 3, begin: at, start, end });
    at = end;
  }
  return fields;
}

function contentOf(bytes, wire, at) {
  if (wire === 0) return { start: at, end: readVarint(bytes, at).end };
  if (wire === 1) return { start: at, end: at + 8 };
  if (wire === 5) return { start: at, end: at + 4 };
  if (wire !== LENGTH_DELIMITED) throw new RangeError(`protobuf: unknown wire type ${wire}`);
  const length = readVarint(bytes, at);
  return { start: length.end, end: length.end + length.value };
}

function nameOf(bytes, start, end) {
  const field = fieldsOf(bytes, start, end).find(({ number }) => number === TENSOR_NAME);
  return field ? new TextDecoder().decode(bytes.subarray(field.start, field.end)) : "";
}

function readVarint(bytes, at) {
  let value = 0;
  for (let k = 0; k < 10 && at + k < bytes.length; k += 1) {
    value += (bytes[at + k] & 0x7f) * 2 ** (7 * k);
    if (bytes[at + k] < 0x80) return { value, end: at + k + 1 };
  }
  throw new RangeError("protobuf: a number does not end");
}

function varint(value) {
  return value < 0x80 ? [value] : [(value % 0x80) | 0x80, ...varint(Math.floor(value / 0x80))];
}

function concatenated(parts) {
  const out = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
  let at = 0;
  for (const part of parts) {
    out.set(part, at);
    at += part.length;
  }
  return out;
}
