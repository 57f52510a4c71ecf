// The scheme as a program for `sepv verify --exec "node laws.js"`: one line of JSON in, one line out
// (sepv's docs/protocol.md).
import { createInterface } from "node:readline";
import { heun } from "./heun.js";

const HELLO = {
  protocol: 1, scheme: "drifting heun", problems: ["harmonic-oscillator", "rigid-body"], polynomial: true,
  max_steps: 256, claims: ["noise-sum", "random-step", "expansion"], mean_square_order: 1, truncation: null,
};

// JavaScript has no hex floats, so sign, digits and exponent are converted here, without a rounding.
function read(text) {
  const [, sign, whole, digits = "", exponent] = /^(-?)0x([01])\.?([0-9a-f]*)p([+-]?\d+)$/.exec(text);
  const mantissa = parseInt(whole + digits, 16); // at most 53 bits: exact
  const half = Math.trunc(Number(exponent) / 2); // two factors, because one could underflow for subnormals
  const scale = Number(exponent) - half - 4 * digits.length;
  return (sign ? -1 : 1) * mantissa * 2 ** half * 2 ** scale;
}

function write(value) {
  if (!Number.isFinite(value)) throw new Error("not finite");
  const bits = new DataView(new ArrayBuffer(8));
  bits.setFloat64(0, value);
  const high = bits.getUint32(0), exponent = (high >>> 20) & 0x7ff;
  const digits = (high & 0xfffff).toString(16).padStart(5, "0") + bits.getUint32(4).toString(16).padStart(8, "0");
  const power = exponent ? exponent - 1023 : -1022;
  return `${high >>> 31 ? "-" : ""}0x${exponent ? 1 : 0}.${digits}p${power < 0 ? "" : "+"}${power}`;
}

function polynomial(terms) {
  const table = terms.map(([exponents, c]) => [exponents, read(c)]);
  return (y) => table.reduce((sum, [e, c]) => sum + e.reduce((term, power, i) => term * y[i] ** power, c), 0);
}

function derivative(terms, k) {
  return terms.filter(([e]) => e[k]).map(([e, c]) => [
    e.map((power, i) => (i === k ? power - 1 : power)), write(read(c) * e[k]),
  ]);
}

// f = B grad H of a problem, or null if the problem is unknown.
function fieldOf(problem) {
  if (problem.name === "harmonic-oscillator") return (y) => [-y[1], y[0]];
  if (problem.name === "rigid-body") {
    const inertia = problem.parameters.inertia.map(read);
    return (y) => {
      const g = y.map((value, i) => value / inertia[i]);
      return [y[1] * g[2] - y[2] * g[1], y[2] * g[0] - y[0] * g[2], y[0] * g[1] - y[1] * g[0]];
    };
  }
  if (problem.name) return null;
  const gradient = [...Array(problem.dimension).keys()].map((k) => polynomial(derivative(problem.hamiltonian, k)));
  const entries = problem.structure.map(([i, j, terms]) => [i, j, polynomial(terms)]);
  return (y) => {
    const g = gradient.map((part) => part(y)), f = y.map(() => 0);
    for (const [i, j, entry] of entries) {
      const b = entry(y);
      f[i] += b * g[j];
      f[j] -= b * g[i];
    }
    return f;
  };
}

function answer(message) {
  if (message.type === "hello") return HELLO;
  if (message.type !== "step") return { error: "unknown type of message" };
  const { problem } = message, field = fieldOf(problem);
  if (!field) return { skip: "unknown problem" };
  const noise = (problem.name ? problem.parameters.noise : problem.noise).map(read);
  try {
    const states = message.steps.map(({ y, h, dW }) => {
      const delta = dW.reduce((sum, w, j) => sum + noise[j] * read(w), read(h));
      return heun(field, y.map(read), delta).map(write);
    });
    return { y_next: states };
  } catch (error) {
    return { error: error.message };
  }
}

for await (const line of createInterface({ input: process.stdin })) {
  const message = JSON.parse(line);
  if (message.type === "stop") break;
  process.stdout.write(JSON.stringify({ id: message.id, ...answer(message) }) + "\n");
}
process.exit(0);
