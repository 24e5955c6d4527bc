//! Models y = B(q)/F(q) u(t − nk) + e/D(q) by refined instrumental variables, for many delays.

use nalgebra::{DMatrix, DVector};

use super::lag_products::lag_matrix;
use super::polynomial::{filter, filter_both, is_stable, reflected};
use super::regression::{Record, dot};
use crate::stop::Stop;

/// Orders of the model.
///
/// Each round simulates B/F u, the noise-free output; fits an autoregression D to what is left; filters input, output and simulation by D/F; and solves for F and B
/// with the filtered simulation as instruments. Poles outside the unit circle are mirrored into it before the next round. Of all rounds the one with the smallest
/// loss Σ(D v)²/rows, v = y − B/F u, is the answer, because rounds need not end where the model is too small for the data.
///
/// Source: Young (2011), "Recursive Estimation and Time-Series Analysis", 2nd ed., chapter 7 (RIV with autoregressive noise), doi:10.1007/978-3-642-21981-8;
/// Ljung (1999), "System Identification", 2nd ed., section 7.6.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RefinedIv {
    /// Numerator coefficients.
    pub nb: usize,
    /// Poles of the plant.
    pub nf: usize,
    /// Poles of the noise.
    pub noise: usize,
}

/// A model of one delay.
#[derive(Debug, Clone, PartialEq)]
pub struct IvFit {
    /// Σ(D v)²/rows.
    pub loss: f64,
    /// b₀ …
    pub b: Vec<f64>,
    /// f₁ … f_nf.
    pub f: Vec<f64>,
    /// d₁ … of D = 1 + d₁q⁻¹ + …
    pub d: Vec<f64>,
    /// The rounds ended because nothing changed any more.
    pub converged: bool,
}

/// Rounds; where they converge at all, some ten suffice.
const ROUNDS: usize = 30;
/// Largest change of a pole polynomial's coefficient between rounds that counts as none.
const SETTLED: f64 = 1e-6;
/// Relative change of the loss between rounds that counts as none: a thousandth of what tells delays apart, at a million samples.
const LEVEL: f64 = 1e-9;
/// A relative ridge of rounding size stands for a rank decision.
const RIDGE: f64 = 1e-13;

fn solve(mut gram: DMatrix<f64>, right: &DVector<f64>) -> Option<DVector<f64>> {
    for i in 0..gram.nrows() {
        gram[(i, i)] += RIDGE * gram[(i, i)].abs() + f64::MIN_POSITIVE;
    }
    gram.lu().solve(right).filter(|x| x.iter().all(|v| v.is_finite()))
}

fn through(x: &[f64], f: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; x.len()];
    filter(x, f, &mut out);
    out
}

/// D x, x being zero before the record.
fn whitened(x: &[f64], d: &[f64]) -> Vec<f64> {
    if let &[d1, d2, d3, d4] = d {
        let padded = [&[0.0; 4], x].concat();
        return padded.windows(5).map(|w| w[4] + d1 * w[3] + d2 * w[2] + d3 * w[1] + d4 * w[0]).collect();
    }
    let mut out = x.to_vec();
    for (i, d) in d.iter().enumerate() {
        for (o, x) in out.iter_mut().skip(i + 1).zip(x) {
            *o += d * x;
        }
    }
    out
}

/// The product of x(t − i) and y(t − j) over a record, both zero before it.
fn lagged(x: &[f64], y: &[f64], i: usize, j: usize) -> f64 {
    let (n, most) = (x.len(), i.max(j));
    if most >= n { 0.0 } else { dot(&x[most - i..n - i], &y[most - j..n - j]) }
}

/// The autoregression that predicts the signals best, and Σ of its squared errors from row `order` on.
fn autoregression(signals: &[Vec<f64>], order: usize) -> Option<(Vec<f64>, f64)> {
    let mut products = DMatrix::zeros(order + 1, order + 1);
    let long = || signals.iter().filter(|v| v.len() > order);
    for v in long() {
        products += lag_matrix(v, None, order, (order + 1, order + 1));
    }
    let gram = products.view((1, 1), (order, order)).into_owned();
    let right = -DVector::from_fn(order, |i, _| products[(i + 1, 0)]);
    let d: Vec<f64> = solve(gram, &right)?.iter().copied().collect();
    let squares = long().map(|v| {
        let e = whitened(v, &d);
        dot(&e[order..], &e[order..])
    });
    let loss = squares.sum();
    Some((d, loss))
}

/// A record with F given: the output, and the input divided by F.
struct Filtered<'a> {
    y: &'a [f64],
    uf: Vec<f64>,
}

/// And with D given: both through it, the input divided by F before.
struct White {
    u: Vec<f64>,
    y: Vec<f64>,
}

impl Filtered<'_> {
    fn white(&self, d: &[f64]) -> White {
        White { u: whitened(&self.uf, d), y: whitened(self.y, d) }
    }

    /// B/F u.
    fn simulated(&self, nk: usize, b: &[f64]) -> Vec<f64> {
        combined(&self.uf, nk, b)
    }
}

/// B x(t − nk), x being zero before the record.
fn combined(x: &[f64], nk: usize, b: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; x.len()];
    for (i, b) in b.iter().enumerate() {
        for (o, x) in out.iter_mut().skip(nk + i).zip(x) {
            *o += b * x;
        }
    }
    out
}

impl RefinedIv {
    /// The best model for nk = 0 … `max_delay`, on records that begin at rest and have no missing sample; `None` for a delay that has none.
    #[must_use]
    pub fn scan(&self, records: &[Record], max_delay: usize) -> Vec<Option<IvFit>> {
        self.scan_until(records, max_delay, &Stop::default())
    }

    /// [`Self::scan`] that breaks off once it is wished; what it gives then says nothing.
    #[must_use]
    pub fn scan_until(&self, records: &[Record], max_delay: usize, stop: &Stop) -> Vec<Option<IvFit>> {
        let mut fits: Vec<Option<IvFit>> = vec![None; max_delay + 1];
        for upwards in [true, false] {
            for step in 0..=max_delay {
                let nk = if upwards { step } else { max_delay - step };
                if stop.is_set() {
                    return fits;
                }
                let neighbour = if upwards { nk.checked_sub(1) } else { Some(nk + 1) };
                let neighbour = neighbour.and_then(|n| fits.get(n)?.as_ref()).map(|f| f.f.clone());
                let first = if upwards { self.least_squares(records, nk) } else { None };
                for start in first.into_iter().chain(neighbour) {
                    let known = fits[nk].as_ref();
                    if known.is_some_and(|k| k.f.iter().zip(&start).all(|(a, b)| (a - b).abs() <= 1e-3)) {
                        continue;
                    }
                    if let Some(fit) = self.refine(records, nk, start)
                        && known.is_none_or(|k| fit.loss < k.loss)
                    {
                        fits[nk] = Some(fit);
                    }
                }
            }
        }
        fits
    }

    /// Σ of squared errors without any input, over the rows of [`Self::scan`]'s losses.
    #[must_use]
    pub fn loss_without_input(&self, records: &[Record]) -> Option<f64> {
        let y: Vec<Vec<f64>> = records.iter().map(|r| r.y[..r.len()].to_vec()).collect();
        Some(autoregression(&y, self.noise)?.1 / self.rows(records))
    }

    fn rows(&self, records: &[Record]) -> f64 {
        let rows: usize = records.iter().map(|r| r.len().saturating_sub(self.noise)).sum();

        rows.max(1) as f64
    }

    /// F and B with the given instruments in the place of the past outputs.
    fn instrumental(&self, signals: &[[Vec<f64>; 3]], nk: usize) -> Option<Vec<f64>> {
        let (nf, k) = (self.nf, self.nf + self.nb);
        let (mut cross, mut right) = (DMatrix::zeros(k, k), DVector::zeros(k));
        for [u, y, x] in signals {
            // Signal, lag and sign of a column.
            let column = |own, i: usize| if i < nf { (own, i + 1, -1.0) } else { (u, nk + i - nf, 1.0) };
            for i in 0..k {
                let (z, lag, sign): (&Vec<f64>, _, _) = column(x, i);
                right[i] += sign * lagged(z, y, lag, 0);
                for j in 0..k {
                    let (past, other, own) = column(y, j);
                    cross[(i, j)] += sign * own * lagged(z, past, lag, other);
                }
            }
        }
        Some(solve(cross, &right)?.iter().take(nf).copied().collect())
    }

    /// The start: least squares, the outputs being their own instruments.
    fn least_squares(&self, records: &[Record], nk: usize) -> Option<Vec<f64>> {
        let signals: Vec<[Vec<f64>; 3]> =
            records.iter().map(|r| [r.u[..r.len()].to_vec(), r.y[..r.len()].to_vec(), r.y[..r.len()].to_vec()]).collect();
        self.instrumental(&signals, nk)
    }

    /// B for given F and D, by least squares on the whitened signals.
    fn numerator(&self, white: &[White], nk: usize) -> Option<Vec<f64>> {
        let (mut gram, mut right) = (DMatrix::zeros(self.nb, self.nb), DVector::zeros(self.nb));
        for White { u, y } in white {
            for i in 0..self.nb {
                right[i] += lagged(u, y, nk + i, 0);
                for j in 0..self.nb {
                    gram[(i, j)] += lagged(u, u, nk + i, nk + j);
                }
            }
        }
        Some(solve(gram, &right)?.iter().copied().collect())
    }

    fn refine(&self, records: &[Record], nk: usize, start: Vec<f64>) -> Option<IvFit> {
        let rows = self.rows(records);
        let mut f = start;
        let mut d = Vec::new();
        let mut best: Option<IvFit> = None;
        let (mut settled, mut last) = (false, f64::INFINITY);
        for _ in 0..ROUNDS {
            f = match reflected(&f).filter(|f| is_stable(f)) {
                Some(f) => f,
                None => break,
            };
            let filtered: Vec<Filtered> = records
                .iter()
                .map(|r| {
                    let (u, y) = (&r.u[..r.len()], &r.y[..r.len()]);
                    Filtered { y, uf: through(u, &f) }
                })
                .collect();
            let whitened_by = |d: &[f64]| filtered.iter().map(|r| r.white(d)).collect::<Vec<White>>();
            let Some(first) = self.numerator(&whitened_by(&d), nk) else { break };
            let left = |r: &Filtered| -> Vec<f64> { r.y.iter().zip(r.simulated(nk, &first)).map(|(y, x)| y - x).collect() };
            let rest: Vec<Vec<f64>> = filtered.iter().map(left).collect();
            let Some((noise, _)) = autoregression(&rest, self.noise) else { break };
            d = noise;
            // B again, under the noise just found.
            let white = whitened_by(&d);
            let Some(b) = self.numerator(&white, nk) else { break };
            let errors = white.iter().filter(|w| w.y.len() > self.noise).map(|w| {
                // D(y − B/F u).
                let e: Vec<f64> = w.y.iter().zip(combined(&w.u, nk, &b)).map(|(y, x)| y - x).collect();
                dot(&e[self.noise..], &e[self.noise..])
            });
            let loss = errors.sum::<f64>() / rows;
            if !loss.is_finite() {
                break;
            }
            if best.as_ref().is_none_or(|b| loss < b.loss) {
                best = Some(IvFit { loss, b: b.clone(), f: f.clone(), d: d.clone(), converged: false });
            }
            settled |= (loss - last).abs() <= LEVEL * loss;
            if settled {
                break;
            }
            last = loss;
            // All by D/F: the input is already.
            let signals: Vec<[Vec<f64>; 3]> = white
                .into_iter()
                .map(|White { u, y }| {
                    let simulated = combined(&u, nk, &b);
                    let (mut yf, mut xf) = (vec![0.0; y.len()], vec![0.0; y.len()]);
                    filter_both([&y, &simulated], &f, [&mut yf, &mut xf]);
                    [u, yf, xf]
                })
                .collect();
            let Some(next) = self.instrumental(&signals, nk) else { break };
            let change = next.iter().zip(&f).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            settled = change <= SETTLED;
            f = next;
        }
        best.map(|fit| IvFit { converged: settled, ..fit })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// y = 0.5·q⁻³/(1 − 1.5q⁻¹ + 0.7q⁻²) u + e/(1 − 0.9q⁻¹), where least squares is biased.
    fn record(samples: usize, seed: u64) -> Record<'static> {
        let mut state = seed;
        let mut next = || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let u: Vec<f64> = (0..samples).map(|_| next()).collect();
        let e: Vec<f64> = (0..samples).map(|_| next()).collect();
        let delayed: Vec<f64> = (0..samples).map(|t| if t < 3 { 0.0 } else { 0.5 * u[t - 3] }).collect();
        let (x, v) = (through(&delayed, &[-1.5, 0.7]), through(&e, &[-0.9]));
        Record::new(u, x.iter().zip(&v).map(|(x, v)| x + v).collect::<Vec<f64>>())
    }

    #[test]
    fn plant_and_noise_are_found_where_least_squares_is_biased() {
        let records = [record(6000, 3), record(5000, 4)];
        let orders = RefinedIv { nb: 1, nf: 2, noise: 1 };
        let biased = orders.least_squares(&records, 3).unwrap();
        assert!((biased[0] + 1.5).abs() > 0.1, "{biased:?}");
        let fits = orders.scan(&records, 6);
        let best = (0..7).min_by(|&a, &b| fits[a].as_ref().unwrap().loss.total_cmp(&fits[b].as_ref().unwrap().loss)).unwrap();
        let fit = fits[best].as_ref().unwrap();
        assert_eq!((best, fit.converged), (3, true));
        for (got, want) in fit.f.iter().chain(&fit.b).chain(&fit.d).zip([-1.5, 0.7, 0.5, -0.9]) {
            assert!((got - want).abs() < 0.03, "{fit:?}");
        }
        // Uniform errors of width 1.
        assert!((fit.loss * 12.0 - 1.0).abs() < 0.05, "{fit:?}");
    }
}
