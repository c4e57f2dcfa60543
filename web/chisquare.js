/** Quantiles of the chi-square distribution, as insenv/evaluation/chi_square.py has them from SciPy.
 *
 * Abramowitz and Stegun 1964: eq. 26.4.19, P(chi^2 | n) is the regularised incomplete gamma function P(n/2, chi^2/2); its
 * series 6.5.29 and continued fraction 6.5.31; Stirling's series 6.1.41; the normal quantile 26.2.23 and the cube of
 * Wilson and Hilferty 26.4.17, from which Newton's iteration starts.
 */

/** The value below which a chi-square of so many degrees of freedom lies with a probability.
 * @param {number} probability
 * @param {number} degrees  above 0, a whole number or not
 * @returns {number} */
export function chiSquareQuantile(probability, degrees) {
  const a = degrees / 2;
  let x = guess(probability, a);
  for (let turn = 0; turn < 100; turn++) {
    const density = Math.exp((a - 1) * Math.log(x) - x - logGamma(a));
    const step = (lowerGamma(a, x) - probability) / density;
    const next = x - step / (1 - 0.5 * Math.min(1, step * ((a - 1) / x - 1)));
    const change = Math.abs(next - x);
    x = next > 0 ? next : x / 2;
    if (change < 1e-13 * x) break;
  }
  return 2 * x;
}

/** @param {number} probability
 * @param {number} a  half the degrees of freedom */
function guess(probability, a) {
  if (a < 0.5) {
    const whole = 1 - a * (0.253 + 0.12 * a); // P(a, 1), about
    return probability < whole ? (probability / whole) ** (1 / a) : 1 - Math.log(1 - (probability - whole) / (1 - whole));
  }
  const t = Math.sqrt(-2 * Math.log(Math.min(probability, 1 - probability)));
  const normal = t - (2.30753 + 0.27061 * t) / (1 + t * (0.99229 + 0.04481 * t));
  const sign = probability < 0.5 ? -1 : 1;
  return a * Math.max(1e-3, 1 - 1 / (9 * a) + (sign * normal) / (3 * Math.sqrt(a))) ** 3;
}

/** The regularised lower incomplete gamma function P(a, x).
 * @param {number} a
 * @param {number} x */
function lowerGamma(a, x) {
  const factor = Math.exp(a * Math.log(x) - x - logGamma(a));
  if (x < a + 1) {
    let [term, sum] = [1 / a, 1 / a];
    for (let n = 1; term > 1e-17 * sum; n++) sum += term *= x / (a + n);
    return factor * sum;
  }
  let [b, c, d] = [x + 1 - a, Infinity, 1 / (x + 1 - a)];
  let value = d;
  for (let n = 1; ; n++) {
    const an = n * (a - n);
    b += 2;
    d = 1 / (an * d + b);
    c = b + an / c;
    value *= c * d;
    if (Math.abs(c * d - 1) < 1e-15 || n > 100000) return 1 - factor * value;
  }
}

/** @param {number} a  above 0 */
function logGamma(a) {
  let [shift, z] = [0, a];
  while (z < 15) shift += Math.log(z++);
  const series = 1 / (12 * z) - 1 / (360 * z ** 3) + 1 / (1260 * z ** 5) - 1 / (1680 * z ** 7);
  return (z - 0.5) * Math.log(z) - z + 0.5 * Math.log(2 * Math.PI) + series - shift;
}
