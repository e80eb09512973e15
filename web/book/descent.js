/* SGD with momentum along one direction of curvature λ: h = m h + r λ w, w = w − h. */

const CLOSE = 1e-9; // a discriminant that rounding leaves of 0

/* The errors w of all steps, from w = start and h = 0: steps + 1 numbers. */
export function errors(curvature, rate, momentum, start, steps) {
  const found = [start];
  let w = start, h = 0;
  for (let t = 0; t < steps; t++) {
    h = momentum * h + rate * curvature * w;
    w -= h;
    found.push(w);
  }
  return found;
}

/* The roots [re, im] of z² − (1 + m − rλ) z + m, the larger one first. */
export function roots(curvature, rate, momentum) {
  const b = 1 + momentum - rate * curvature, discriminant = b * b - 4 * momentum;
  if (Math.abs(discriminant) < CLOSE) return [[b / 2, 0], [b / 2, 0]];
  const part = Math.sqrt(Math.abs(discriminant)) / 2;
  if (discriminant < 0) return [[b / 2, part], [b / 2, -part]];
  const pair = [b / 2 + part, b / 2 - part];
  return pair.sort((p, q) => Math.abs(q) - Math.abs(p)).map((re) => [re, 0]);
}

export const size = ([re, im]) => Math.hypot(re, im);

/* What the roots say of the errors in the long run, in words. */
export function outlook([first, second]) {
  const largest = size(first), isDouble = first[0] === second[0] && first[1] === second[1];
  if (largest > 1 + CLOSE) return "diverges";
  if (largest > 1 - CLOSE) return "does not converge";
  if (first[1]) return "a complex pair: it oscillates";
  if (isDouble && first[0]) {
    return `a double root: (A + B t) zᵗ, ${first[0] < 0 ? "the sign changes in every step" : "without oscillation"}`;
  }
  return first[0] < 0 ? "a negative root: it changes sign in every step" : "real roots: it decays without oscillating";
}

/* Rate and momentum of a named choice for curvatures 1 … κ. */
export const CHOICES = {
  plain: { title: "best without momentum", of: (kappa) => [2 / (1 + kappa), 0] },
  fast: { title: "too fast without momentum", of: (kappa) => [2.1 / kappa, 0] },
  best: {
    title: "best with momentum",
    of(kappa) {
      const s = (Math.sqrt(kappa) - 1) / (Math.sqrt(kappa) + 1);
      return [(1 - s) ** 2, s * s];
    },
  },
  heavy: { title: "m = 0.9", of: (kappa) => [1 / kappa, 0.9] },
};
