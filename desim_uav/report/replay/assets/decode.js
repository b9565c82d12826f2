// Decodes the page's text into typed arrays. A block is deflated, in base64: a line of JSON,
// [[name, coding, count, bytes, scale], …], followed by the bodies of its columns.

/** The JSON of a data element. */
export function readJson(id) {
  return JSON.parse(document.getElementById(id).textContent);
}

/** Whether this browser can inflate. */
export function canInflate() {
  return typeof DecompressionStream === "function";
}

/** The columns of a block of the page, by name. */
export async function readBlock(id) {
  const bytes = await inflate(fromBase64(document.getElementById(id).textContent.trim()));
  return columnsOf(bytes);
}

function fromBase64(text) {
  if (typeof Uint8Array.fromBase64 === "function") return Uint8Array.fromBase64(text);
  const binary = atob(text);
  const bytes = new Uint8Array(binary.length);
  for (let i = 0; i < binary.length; i += 1) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function columnsOf(bytes) {
  const end = bytes.indexOf(10);
  const heads = JSON.parse(new TextDecoder().decode(bytes.subarray(0, end)));
  const found = {};
  let at = end + 1;
  for (const [name, coding, count, size, scale] of heads) {
    found[name] = read(coding, bytes.subarray(at, at + size), count, scale);
    at += size;
  }
  return found;
}

function read(coding, body, count, scale) {
  if (coding === "bytes") return body.slice();
  if (coding === "float") return new Float64Array(body.slice().buffer);
  const values = new Float64Array(count);
  let at = 0;
  let sum = 0;
  for (let i = 0; i < count; i += 1) {
    let byte = body[at++];
    let whole = byte & 127;
    let weight = 128;
    while (byte > 127) {
      byte = body[at++];
      whole += (byte & 127) * weight; // above 2^31 too: times are microseconds
      weight *= 128;
    }
    const value = whole % 2 ? -(whole + 1) / 2 : whole / 2;
    if (coding === "delta") sum += value;
    values[i] = (coding === "delta" ? sum : value) * scale;
  }
  return values;
}
