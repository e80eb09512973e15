/* The messages of a skeleton file, as layers/hand/skeleton_file.py has them, read from a prototxt's tree.

   A message is an object of its fields, and remembers the tree: placeOf(message, "field") says where it stands. */

import { PrototxtError } from "./prototxt.js";

const AXES = ["X", "Y", "Z", "NEG_X", "NEG_Y", "NEG_Z"];
const required = (kind) => ({ kind, required: true });
const optional = (kind, value) => ({ kind, value });
const repeated = (kind) => ({ kind, repeated: true });

const MESSAGES = {
  dof: {
    name: required("string"),
    initial: optional("number", 0), // added to the input
    lower: optional("number", -Infinity), // limits of the input
    upper: optional("number", Infinity),
    fixed: optional("bool", false), // keeps the initial value, ignores the input
    deviation: optional("number", Infinity),
  },
  motion: { axis: required("axis"), dof: required("string") },
  bone: { axis: required("axis"), length: required("number") },
  joint: {
    name: required("string"),
    parent: optional("string", null), // none: starts at the origin
    translate: repeated("motion"),
    rotate: repeated("motion"),
    bone: optional("bone", null),
  },
  offset: {
    joint: required("string"), axes: required("string"),
    x: optional("number", 0), y: optional("number", 0), z: optional("number", 0),
  },
  capsule: {
    from: required("string"), to: required("string"), radius: { ...repeated("number"), required: true },
    part: optional("string", ""),
  },
  wedge: {
    joint: { ...repeated("string"), required: true }, radius: { ...repeated("number"), required: true },
    part: optional("string", ""),
  },
  flesh: {
    dof: repeated("dof"), joint: repeated("joint"), offset: repeated("offset"), capsule: repeated("capsule"),
    wedge: repeated("wedge"),
  },
  skeleton: {
    name: optional("string", ""), dof: repeated("dof"), joint: repeated("joint"), flesh: optional("flesh", null),
  },
};
const EXPECTED = {
  string: "a string in quotes", number: "a number", bool: "true or false", axis: AXES.join(" or "),
};
const BOOLS = { true: true, t: true, True: true, 1: true, false: false, f: false, False: false, 0: false };

/* Fill a message of this kind from a tree; `what` names it in errors. Throws PrototxtError at what is wrong. */
export function read(tree, kind, what = kind) {
  const specs = MESSAGES[kind], given = new Map();
  for (const field of tree.fields) {
    if (!Object.hasOwn(specs, field.name)) {
      const known = Object.keys(specs).join(", ");
      throw new PrototxtError(field.place, `unknown field '${field.name}'; known fields: ${known}`);
    }
    if (!given.has(field.name)) given.set(field.name, []);
    given.get(field.name).push(field);
  }
  const message = {};
  for (const [name, fields] of given) message[name] = valueOfField(fields, specs[name]);
  for (const [name, spec] of Object.entries(specs)) {
    if (name in message) continue;
    if (spec.required) throw new PrototxtError(tree.place, `missing required field '${name}' in ${what}`);
    message[name] = spec.repeated ? [] : spec.value;
  }
  Object.defineProperty(message, "tree", { value: tree }); // not enumerable: it is no field
  return message;
}

/* Where a message, or one field of it, stands in its file. */
export function placeOf(message, name = null) {
  return (message.tree.fields.find((field) => field.name === name) ?? message.tree).place;
}

function valueOfField(fields, spec) {
  if (spec.repeated) return fields.map((field) => valueOf(field, spec.kind));
  const [first, second] = fields;
  if (!second) return valueOf(first, spec.kind);
  if (!(spec.kind in MESSAGES)) {
    throw new PrototxtError(second.place, `field '${first.name}' is given twice, but is not a repeated field`);
  }
  const parts = fields.map(treeOf); // a message that is written in parts
  return read({ ...parts[0], fields: parts.flatMap((part) => part.fields) }, spec.kind, first.name);
}

function treeOf(field) {
  if (field.value.kind === "message") return field.value;
  const found = `expected ${field.name} { ... }, found ${field.value.text}`;
  throw new PrototxtError(field.place, `'${field.name}' is a message: ${found}`);
}

function valueOf(field, kind) {
  if (kind in MESSAGES) return read(treeOf(field), kind, field.name);
  const { value } = field;
  if (value.kind === "message") {
    const expected = `expected '${field.name}: ${EXPECTED[kind]}'`;
    throw new PrototxtError(field.place, `'${field.name}' is not a message: ${expected}`);
  }
  const result = scalar(value, kind);
  if (result !== null) return result;
  if (kind === "axis" && value.kind !== "string") {
    const known = AXES.join(", ");
    throw new PrototxtError(value.place, `unknown value ${value.text} of '${field.name}'; known values: ${known}`);
  }
  const found = value.kind === "string" ? JSON.stringify(value.text) : value.text;
  const expected = kind === "axis" ? "a name without quotes" : EXPECTED[kind];
  throw new PrototxtError(value.place, `'${field.name}' expects ${expected}, found ${found}`);
}

/* The value of a scalar, or null if it is not of that kind. */
function scalar(value, kind) {
  if (kind === "string" || value.kind === "string") return kind === value.kind ? value.text : null;
  if (kind === "bool") return Object.hasOwn(BOOLS, value.text) ? BOOLS[value.text] : null;
  if (kind === "axis") return AXES.includes(value.text) ? value.text : AXES[integer(value.text)] ?? null;
  return number(value);
}

function number(value) {
  if (value.kind === "word") {
    const word = /^(-?)(inf|infinity|nan)$/i.exec(value.text);
    return word ? (word[1] ? -1 : 1) * (word[2][0].toLowerCase() === "i" ? Infinity : NaN) : null;
  }
  return integer(value.text) ?? Number(value.text.replace(/f$/i, ""));
}

function integer(text) {
  const match = /^(-?)(?:0x([\da-f]+)|0([0-7]+)|(\d+))$/i.exec(text);
  if (!match) return null;
  const [, minus, hexa, octal, decimal] = match;
  const size = hexa ? parseInt(hexa, 16) : octal ? parseInt(octal, 8) : Number(decimal);
  return minus ? -size : size;
}
