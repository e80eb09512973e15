/* Protocol-buffer text format to a tree, as netlib/prototxt.py reads it: the grammar, and no field names.

   A field is {name, value, place}. A value is {kind: "string" | "number" | "word", text, place}, or
   {kind: "message", fields, place}. A place is {source, line, column}, both counted from 1. */

const MAX_DEPTH = 100;
const SKIP = /(?:[ \t\r\n\f\v]+|#[^\n]*)+/y;
const TOKENS = [
  ["number", /-?[ \t]*(?:0[xX][0-9a-fA-F]+|(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?[fF]?)(?![\w.])/y],
  ["word", /-?[A-Za-z_]\w*/y],
  ["string", /"(?:[^"\\\n]|\\.)*"|'(?:[^'\\\n]|\\.)*'/y],
  ["mark", /[{}<>[\]:,;]/y],
];
const ESCAPE = /\\(?:([0-7]{1,3})|[xX]([0-9a-fA-F]{1,2})|u([0-9a-fA-F]{4})|U([0-9a-fA-F]{8})|(.))/gs;
const MAX_STRING = 10_000; // characters of a string
const MAX_ERROR = 500; // characters of an error
const SIMPLE_ESCAPES = { n: 10, r: 13, t: 9, a: 7, b: 8, f: 12, v: 11, "\\": 92, "'": 39, '"': 34, "?": 63 };

/* Text that is not a valid prototxt, or says what a skeleton cannot be: one line that begins with the place. */
export class PrototxtError extends Error {
  constructor(place, message) {
    const shown = message.length > MAX_ERROR ? `${message.slice(0, MAX_ERROR)} ...` : message;
    super(`${place.source}:${place.line}:${place.column}: error: ${shown}`);
  }
}

/* The message that a whole text is; `source` names it in errors. */
export function parse(text, source) {
  const parser = new Parser(tokens(text.replace(/^\ufeff/, ""), source));
  return { kind: "message", fields: parser.file(), place: { source, line: 1, column: 1 } };
}

function tokens(text, source) {
  const found = [];
  let offset = 0, line = 1, column = 1;
  for (;;) {
    SKIP.lastIndex = offset;
    const skipped = SKIP.exec(text);
    if (skipped) {
      const lines = skipped[0].split("\n"), last = [...lines.at(-1)].length;
      line += lines.length - 1;
      column = lines.length > 1 ? last + 1 : column + last;
      offset += skipped[0].length;
    }
    const place = { source, line, column };
    if (offset >= text.length) return [...found, { kind: "end", text: "", place }];
    const token = tokenAt(text, offset);
    if (!token) throw new PrototxtError(place, lexicalFault(text.slice(offset).split("\n", 1)[0]));
    found.push({ ...token, place });
    offset += token.text.length;
    column += [...token.text].length;
  }
}

function tokenAt(text, offset) {
  for (const [kind, pattern] of TOKENS) {
    pattern.lastIndex = offset;
    const match = pattern.exec(text);
    if (match) return { kind, text: match[0] };
  }
  return null;
}

function lexicalFault(rest) {
  if (`"'`.includes(rest[0])) return "string without a closing quote on this line";
  if (/[\d.-]/.test(rest[0])) return `malformed number '${rest.split(/\s/)[0]}'`;
  return `unexpected character '${String.fromCodePoint(rest.codePointAt(0))}'`;
}

/* What a string between quotes stands for. Escapes are bytes, all else itself. */
function unquote(token) {
  if (token.text.length > MAX_STRING) {
    throw new PrototxtError(token.place, `string of ${token.text.length} characters; at most ${MAX_STRING} are read`);
  }
  const inside = token.text.slice(1, -1), bytes = [], encoder = new TextEncoder();
  let end = 0;
  for (const match of inside.matchAll(ESCAPE)) {
    const [whole, octal, hexa, short, long, simple] = match;
    bytes.push(...encoder.encode(inside.slice(end, match.index)));
    end = match.index + whole.length;
    if (octal || hexa) {
      bytes.push(octal ? parseInt(octal, 8) & 255 : parseInt(hexa, 16));
    } else if (short || long) {
      const code = parseInt(short || long, 16);
      if (code > 0x10ffff || (code >= 0xd800 && code <= 0xdfff)) {
        throw new PrototxtError(token.place, `escape ${whole} is not a character`);
      }
      bytes.push(...encoder.encode(String.fromCodePoint(code)));
    } else if (simple in SIMPLE_ESCAPES) {
      bytes.push(SIMPLE_ESCAPES[simple]);
    } else {
      throw new PrototxtError(token.place, `unknown escape '\\${simple}' in a string`);
    }
  }
  return [...bytes, ...encoder.encode(inside.slice(end))];
}

/*   text   = { field }
     field  = name [ ":" ] message(s) | name ":" value     then an optional "," or ";"
     message= "{" text "}" | "<" text ">"
     value  = scalar | "[" value { "," value } "]"
     scalar = one or more adjacent strings | number | word */
class Parser {
  constructor(found) {
    this.found = found;
    this.next = 0;
    this.depth = 0;
  }

  get token() {
    return this.found[this.next];
  }

  take() {
    return this.found[this.next++];
  }

  at(marks) {
    return this.token.kind === "mark" && marks.includes(this.token.text);
  }

  fail(expected) {
    const found = this.token.kind === "end" ? "the end of the file" : `'${this.token.text}'`;
    return new PrototxtError(this.token.place, `expected ${expected}, found ${found}`);
  }

  file() {
    const fields = this.fields();
    if (this.token.kind !== "end") throw this.fail("a field name");
    return fields;
  }

  fields() {
    const fields = [];
    while (this.token.kind === "word" && !this.token.text.startsWith("-")) {
      for (const field of this.field()) fields.push(field); // a list may be longer than a call's arguments
      if (this.at(",;")) this.take();
    }
    return fields;
  }

  /* One field as written; a list gives one for each element. */
  field() {
    const name = this.take(), colon = this.at(":");
    if (colon) this.take();
    else if (!this.at("{<[")) throw this.fail(`':' or '{' after '${name.text}'`);
    if (!this.at("[")) return [{ name: name.text, value: this.value(), place: name.place }];
    this.take();
    const fields = [];
    while (!this.at("]")) {
      const place = this.token.place;
      if (!colon && !this.at("{<")) throw this.fail(`'{' in a list without ':' after '${name.text}'`);
      fields.push({ name: name.text, value: this.value(), place });
      if (!this.at(",")) break;
      this.take();
      if (this.at("]")) throw this.fail("a value");
    }
    this.close("]");
    return fields;
  }

  value() {
    if (this.at("{<")) return this.message();
    const { kind, text, place } = this.token;
    if (kind === "number" || kind === "word") {
      this.take();
      return { kind, text: text.replace(/\s/g, ""), place };
    }
    if (kind !== "string") throw this.fail("a value");
    const bytes = [];
    while (this.token.kind === "string") for (const byte of unquote(this.take())) bytes.push(byte);
    return { kind, text: new TextDecoder().decode(new Uint8Array(bytes)), place };
  }

  message() {
    const opening = this.token;
    if (++this.depth > MAX_DEPTH) {
      throw new PrototxtError(opening.place, `messages are nested more than ${MAX_DEPTH} deep`);
    }
    this.take();
    const fields = this.fields();
    this.close(opening.text === "{" ? "}" : ">", opening.place);
    this.depth--;
    return { kind: "message", fields, place: opening.place };
  }

  close(mark, opened = null) {
    const expected = opened ? `a field name or '${mark}' (opened at line ${opened.line})` : `',' or '${mark}'`;
    if (!this.at(mark)) throw this.fail(expected);
    this.take();
  }
}
