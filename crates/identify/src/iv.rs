//! Models y = B(q)/F(q) u(t − nk) + e/D(q) by refined instrumental variables, for many delays.

use std::borrow::Cow;

use nalgebra::{DMatrix, DVector};

use super::lag_products::lag_matrix;
use super::polynomial::{filter, filter_both, is_stable, reflected};
use super::regression::{Record, dot};
use deadtime_signal::stop::Stop;

/// Orders of the model.
///
/// Each round simulates the noise-free output B/F u and fits an autoregression D to the residual. The round filters input, output and simulation by D/F, and
/// solves for F and B with the filtered simulation as instruments. Poles outside the unit circle are mirrored into it before the next round. The result is the
/// round with the smallest loss Σ(D v)²/rows, v = y − B/F u. For too small a model, the last round may be worse.
///
/// Source: Young (2011), "Recursive Estimation and Time-Series Analysis", 2nd ed., chapter 7 (RIV with autoregressive noise), doi:10.1007/978-3-642-21981-8.
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
    /// The rounds converged.
    pub converged: bool,
}

/// Largest number of rounds; where they converge at all, about ten suffice.
const ROUNDS: usize = 30;
/// Largest change of a pole polynomial's coefficient between converged rounds.
const SETTLED: f64 = 1e-6;
/// Relative change of the loss between converged rounds: a thousandth of the resolution between delays, at a million samples.
const LEVEL: f64 = 1e-9;
/// Largest number of steps of [`RefinedIv::polished`]. The steps end when the predicted fall of the sum of squares, over the noise's variance, is below (1e-3
/// standard deviations)².
const STEPS: usize = 20;
const SMALL: f64 = 1e-6;
/// Corner frequencies of the filters of [`RefinedIv::filtered_starts`], rad per sample.
const CORNERS: [f64; 5] = [0.01, 0.03, 0.1, 0.3, 1.0];
/// A relative ridge of rounding size replaces a rank decision.
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

/// D x, with x zero before the record.
pub(crate) fn whitened(x: &[f64], d: &[f64]) -> Vec<f64> {
    if let &[d1, d2, d3, d4] = d {
        let padded = [&[0.0; 4], x].concat();
        return padded
            .windows(5)
            .map(|w| w[4] + d1 * w[3] + d2 * w[2] + d3 * w[1] + d4 * w[0])
            .collect();
    }
    let mut out = x.to_vec();
    for (i, d) in d.iter().enumerate() {
        for (o, x) in out.iter_mut().skip(i + 1).zip(x) {
            *o += d * x;
        }
    }
    out
}

/// The sum of x(t − i)·y(t − j) over a record, both zero before it.
fn lagged(x: &[f64], y: &[f64], i: usize, j: usize) -> f64 {
    let (n, most) = (x.len(), i.max(j));
    if most >= n { 0.0 } else { dot(&x[most - i..n - i], &y[most - j..n - j]) }
}

/// The best autoregression of the signals, and Σ of its squared errors from row `order` on.
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

/// One input of a model: its samples by record (`None`: zero throughout), the lag of its first coefficient, and their number.
pub struct IvInput<'a> {
    pub samples: Vec<Option<Cow<'a, [f64]>>>,
    pub lag: usize,
    pub count: usize,
}

/// The data of a fit: every input, and the outputs by record.
pub struct IvProblem<'a> {
    pub inputs: Vec<IvInput<'a>>,
    pub outputs: Vec<&'a [f64]>,
}

impl<'a> IvProblem<'a> {
    fn single(records: &'a [Record], lag: usize, count: usize) -> Self {
        let samples = records.iter().map(|r| Some(Cow::Borrowed(&r.u[..r.len()]))).collect();
        Self {
            inputs: vec![IvInput { samples, lag, count }],
            outputs: records.iter().map(|r| &r.y[..r.len()]).collect(),
        }
    }

    /// Input and lag of every coefficient.
    fn places(&self) -> Vec<(usize, usize)> {
        self.inputs
            .iter()
            .enumerate()
            .flat_map(|(j, input)| (0..input.count).map(move |i| (j, input.lag + i)))
            .collect()
    }

    /// Every record with its inputs divided by F.
    fn filtered(&self, f: &[f64]) -> Vec<Filtered<'_>> {
        let one = |(r, y): (usize, &&'a [f64])| {
            let uf = self
                .inputs
                .iter()
                .map(|input| input.samples.get(r)?.as_ref().map(|u| through(u, f)))
                .collect();
            Filtered { y, uf }
        };
        self.outputs.iter().enumerate().map(one).collect()
    }
}

/// A record with F given: the output, and the inputs divided by F.
struct Filtered<'a> {
    y: &'a [f64],
    uf: Vec<Option<Vec<f64>>>,
}

/// The same with D: all signals filtered by D, the inputs already divided by F.
struct White {
    u: Vec<Option<Vec<f64>>>,
    y: Vec<f64>,
}

/// Inputs, output and simulated output (the instrument), all through the same filter.
struct Regressors {
    u: Vec<Option<Vec<f64>>>,
    y: Vec<f64>,
    x: Vec<f64>,
}

impl Filtered<'_> {
    fn white(&self, d: &[f64]) -> White {
        White {
            u: self.uf.iter().map(|u| u.as_ref().map(|u| whitened(u, d))).collect(),
            y: whitened(self.y, d),
        }
    }
}

impl White {
    /// D(y − B/F u).
    fn errors(&self, places: &[(usize, usize)], b: &[f64]) -> Vec<f64> {
        self.y.iter().zip(combined(&self.u, places, b, self.y.len())).map(|(y, x)| y - x).collect()
    }

    /// All signals filtered by D/F; the inputs already are.
    fn regressors(self, f: &[f64], places: &[(usize, usize)], b: &[f64]) -> Regressors {
        let Self { u, y } = self;
        let simulated = combined(&u, places, b, y.len());
        let (mut yf, mut xf) = (vec![0.0; y.len()], vec![0.0; y.len()]);
        filter_both([&y, &simulated], f, [&mut yf, &mut xf]);
        Regressors { u, y: yf, x: xf }
    }
}

/// Σ b·u(t − lag) over all coefficients, with inputs zero before the record.
fn combined(
    u: &[Option<Vec<f64>>],
    places: &[(usize, usize)],
    b: &[f64],
    samples: usize,
) -> Vec<f64> {
    let mut out = vec![0.0; samples];
    for ((input, lag), b) in places.iter().zip(b) {
        for (o, x) in out.iter_mut().skip(*lag).zip(u[*input].iter().flatten()) {
            *o += b * x;
        }
    }
    out
}

impl RefinedIv {
    /// The best model for nk = 0 … `max_delay`, on records that begin at rest without missing samples. `None` for a delay without a model.
    #[must_use]
    pub fn scan(&self, records: &[Record], max_delay: usize) -> Vec<Option<IvFit>> {
        self.scan_until(records, max_delay, &Stop::default())
    }

    /// [`Self::scan`] with cancellation; a cancelled scan has no valid result.
    #[must_use]
    pub fn scan_until(
        &self,
        records: &[Record],
        max_delay: usize,
        stop: &Stop,
    ) -> Vec<Option<IvFit>> {
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
                    if known
                        .is_some_and(|k| k.f.iter().zip(&start).all(|(a, b)| (a - b).abs() <= 1e-3))
                    {
                        continue;
                    }
                    if let Some(fit) = self.refine(&IvProblem::single(records, nk, self.nb), start)
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
        Some(autoregression(&y, self.noise)?.1 / self.rows(y.iter().map(Vec::len)))
    }

    fn rows(&self, lengths: impl Iterator<Item = usize>) -> f64 {
        let rows: usize = lengths.map(|n| n.saturating_sub(self.noise)).sum();

        rows.max(1) as f64
    }

    /// Σ over rows of instruments times regressors, and of instruments times the output. With `symmetric` the regressors are their own instruments.
    fn products(
        &self,
        signals: &[Regressors],
        places: &[(usize, usize)],
        symmetric: bool,
    ) -> (DMatrix<f64>, DVector<f64>) {
        let (nf, k) = (self.nf, self.nf + places.len());
        let (mut cross, mut right) = (DMatrix::zeros(k, k), DVector::zeros(k));
        for Regressors { u, y, x } in signals {
            // Signal, lag and sign of a column.
            let column = |own, i: usize| -> Option<(&Vec<f64>, usize, f64)> {
                if i < nf {
                    return Some((own, i + 1, -1.0));
                }
                let (input, lag) = places[i - nf];
                Some((u[input].as_ref()?, lag, 1.0))
            };
            for i in 0..k {
                let Some((z, lag, sign)) = column(x, i) else { continue };
                right[i] += sign * lagged(z, y, lag, 0);
                for j in 0..k {
                    if let Some((past, other, own)) = column(if symmetric { x } else { y }, j) {
                        cross[(i, j)] += sign * own * lagged(z, past, lag, other);
                    }
                }
            }
        }
        (cross, right)
    }

    /// F with the given instruments instead of the past outputs.
    fn instrumental(&self, signals: &[Regressors], places: &[(usize, usize)]) -> Option<Vec<f64>> {
        let (cross, right) = self.products(signals, places, false);
        Some(solve(cross, &right)?.iter().take(self.nf).copied().collect())
    }

    /// The start: least squares, with the outputs as their own instruments.
    fn least_squares(&self, records: &[Record], nk: usize) -> Option<Vec<f64>> {
        self.start(&IvProblem::single(records, nk, self.nb))
    }

    /// F by least squares, biased by coloured noise: a start for [`Self::refine`].
    pub fn start(&self, problem: &IvProblem<'_>) -> Option<Vec<f64>> {
        let signals: Vec<Regressors> = problem
            .filtered(&[])
            .into_iter()
            .map(|Filtered { y, uf }| Regressors { u: uf, y: y.to_vec(), x: y.to_vec() })
            .collect();
        self.instrumental(&signals, &problem.places())
    }

    /// F by least squares of signals through low-pass filters (1 − λq⁻¹)^−nf of several corners; noise beyond the plant's band does not bias it.
    ///
    /// Source: Garnier, Mensler and Richard (2003), "Continuous-time model identification from sampled data", Int. J. Control 76(13), 1337-1357,
    /// doi:10.1080/0020717031000149636 (state-variable filters).
    pub fn filtered_starts(&self, problem: &IvProblem<'_>) -> Vec<Vec<f64>> {
        let places = problem.places();
        let from = |corner: &f64| {
            let pole = (-corner).exp();
            let mut filter = vec![0.0; self.nf + 1];
            filter[0] = 1.0;
            for degree in 1..=self.nf {
                for i in (1..=degree).rev() {
                    filter[i] -= pole * filter[i - 1];
                }
            }
            let filter = &filter[1..];
            let signals: Vec<Regressors> = problem
                .filtered(filter)
                .into_iter()
                .map(|Filtered { y, uf }| {
                    let y = through(y, filter);
                    Regressors { u: uf, x: y.clone(), y }
                })
                .collect();
            self.instrumental(&signals, &places)
        };
        CORNERS.iter().filter_map(from).collect()
    }

    /// B for given F and D, by least squares on the whitened signals.
    fn numerator(white: &[White], places: &[(usize, usize)]) -> Option<Vec<f64>> {
        let k = places.len();
        let (mut gram, mut right) = (DMatrix::zeros(k, k), DVector::zeros(k));
        for White { u, y } in white {
            for (i, (one, lag)) in places.iter().enumerate() {
                let Some(first) = &u[*one] else { continue };
                right[i] += lagged(first, y, *lag, 0);
                for (j, (other, late)) in places.iter().enumerate() {
                    if let Some(second) = &u[*other] {
                        gram[(i, j)] += lagged(first, second, *lag, *late);
                    }
                }
            }
        }
        Some(solve(gram, &right)?.iter().copied().collect())
    }

    /// The model of one set of lags, from an initial F. The vector b contains those of all inputs, one after the other.
    pub fn refine(&self, problem: &IvProblem<'_>, start: Vec<f64>) -> Option<IvFit> {
        let places = problem.places();
        let mut f = start;
        let mut d = Vec::new();
        let mut best: Option<IvFit> = None;
        let (mut settled, mut last) = (false, f64::INFINITY);
        for _ in 0..ROUNDS {
            f = match reflected(&f).filter(|f| is_stable(f)) {
                Some(f) => f,
                None => break,
            };
            let filtered = problem.filtered(&f);
            let whitened_by =
                |d: &[f64]| filtered.iter().map(|r| r.white(d)).collect::<Vec<White>>();
            let Some(first) = Self::numerator(&whitened_by(&d), &places) else { break };
            let rest: Vec<Vec<f64>> = filtered.iter().map(|r| r.left(&places, &first)).collect();
            let Some((noise, _)) = autoregression(&rest, self.noise) else { break };
            d = noise;
            // B again, under the updated noise model.
            let white = whitened_by(&d);
            let Some(b) = Self::numerator(&white, &places) else { break };
            let loss = self.loss(white.iter().map(|w| w.errors(&places, &b)));
            if !loss.is_finite() {
                break;
            }
            if best.as_ref().is_none_or(|b| loss < b.loss) {
                best = Some(IvFit {
                    loss,
                    b: b.clone(),
                    f: f.clone(),
                    d: d.clone(),
                    converged: false,
                });
            }
            settled |= (loss - last).abs() <= LEVEL * loss;
            if settled {
                break;
            }
            last = loss;
            let signals: Vec<Regressors> =
                white.into_iter().map(|w| w.regressors(&f, &places, &b)).collect();
            let Some(next) = self.instrumental(&signals, &places) else { break };
            let change = next.iter().zip(&f).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            settled = change <= SETTLED;
            f = next;
        }
        best.map(|fit| IvFit { converged: settled, ..fit })
    }

    /// The fit at the minimum of its loss, by Gauss-Newton steps on the residuals; D is refitted after each.
    ///
    /// A round of [`Self::refine`] solves for the parameters themselves, so its ridge shrinks them along poorly determined directions. For fast sampling and
    /// little noise this bias is many standard deviations. A step solves for the change, which is 0 at the minimum under any ridge.
    pub fn polished(&self, problem: &IvProblem<'_>, mut fit: IvFit) -> IvFit {
        let places = problem.places();
        for _ in 0..STEPS {
            let Some((next, decrement)) = self.stepped(problem, &places, &fit) else { break };
            if next.loss.is_nan() || next.loss > fit.loss * (1.0 + LEVEL) {
                break;
            }
            fit = next;
            if decrement <= SMALL * fit.loss {
                break;
            }
        }
        fit
    }

    /// The fit after a step, and the predicted fall of the sum of squares.
    fn stepped(
        &self,
        problem: &IvProblem<'_>,
        places: &[(usize, usize)],
        fit: &IvFit,
    ) -> Option<(IvFit, f64)> {
        let signals = problem.filtered(&fit.f).into_iter().map(|r| {
            let white = r.white(&fit.d);
            let errors = white.errors(places, &fit.b);
            Regressors { y: errors, ..white.regressors(&fit.f, places, &fit.b) }
        });
        let (gram, right) = self.products(&signals.collect::<Vec<_>>(), places, true);
        let change = solve(gram, &right)?;
        let moved = |from: &[f64], at: usize| -> Vec<f64> {
            from.iter().zip(change.iter().skip(at)).map(|(a, b)| a + b).collect()
        };
        let (f, b) = (moved(&fit.f, 0), moved(&fit.b, self.nf));
        if !is_stable(&f) {
            return None;
        }
        let filtered = problem.filtered(&f);
        let left: Vec<Vec<f64>> = filtered.iter().map(|r| r.left(places, &b)).collect();
        let (d, _) = autoregression(&left, self.noise)?;
        let loss = self.loss(filtered.iter().map(|r| r.white(&d).errors(places, &b)));
        Some((IvFit { loss, b, f, d, converged: fit.converged }, right.dot(&change)))
    }

    /// Σ (D v)²/rows over the rows with at least as many predecessors as D has coefficients.
    fn loss(&self, errors: impl Iterator<Item = Vec<f64>>) -> f64 {
        let (mut sum, mut rows) = (0.0, 0);
        for e in errors.filter(|e| e.len() > self.noise) {
            sum += dot(&e[self.noise..], &e[self.noise..]);
            rows += e.len() - self.noise;
        }
        sum / (rows.max(1) as f64)
    }

    /// The asymptotic covariance of f₁ … f_nf and then of all b: σ²·(Σ φ̂φ̂ᵀ)⁻¹. φ̂ are the regressors with the simulated instead of the measured output,
    /// through D/F. σ² uses the remaining degrees of freedom. The covariance is valid where the autoregression is the noise's own.
    ///
    /// Source: Jakeman and Young (1979), Int. J. Control 29(4), 621-644, doi:10.1080/00207177908922724; Young (2011), section 7.3.
    pub fn covariance(&self, problem: &IvProblem<'_>, fit: &IvFit) -> Option<DMatrix<f64>> {
        let places = problem.places();
        let white = problem.filtered(&fit.f).into_iter().map(|r| r.white(&fit.d));
        let signals: Vec<Regressors> =
            white.map(|w| w.regressors(&fit.f, &places, &fit.b)).collect();
        let (gram, _) = self.products(&signals, &places, true);
        let (k, rows) = (gram.nrows(), self.rows(problem.outputs.iter().map(|y| y.len())));
        let freedom = (rows - (k + self.noise) as f64).max(1.0);
        inverse(gram).map(|inverse| inverse * (fit.loss * rows / freedom))
    }

    /// The residual of every output, y − B/F u.
    pub fn left(&self, problem: &IvProblem<'_>, fit: &IvFit) -> Vec<Vec<f64>> {
        let places = problem.places();
        problem.filtered(&fit.f).iter().map(|r| r.left(&places, &fit.b)).collect()
    }
}

impl Filtered<'_> {
    /// y − B/F u.
    fn left(&self, places: &[(usize, usize)], b: &[f64]) -> Vec<f64> {
        self.y.iter().zip(combined(&self.uf, places, b, self.y.len())).map(|(y, x)| y - x).collect()
    }
}

/// The inverse of a positive definite matrix whose columns may differ in size by many powers of ten.
pub(crate) fn inverse(mut gram: DMatrix<f64>) -> Option<DMatrix<f64>> {
    let size: Vec<f64> = gram.diagonal().iter().map(|v| v.max(f64::MIN_POSITIVE).sqrt()).collect();
    for i in 0..gram.nrows() {
        for j in 0..gram.ncols() {
            gram[(i, j)] /= size[i] * size[j];
        }
        gram[(i, i)] += RIDGE;
    }
    let mut inverse = gram.cholesky()?.inverse();
    for i in 0..inverse.nrows() {
        for j in 0..inverse.ncols() {
            inverse[(i, j)] /= size[i] * size[j];
        }
    }
    inverse.iter().all(|v| v.is_finite()).then_some(inverse)
}

/// The autoregression of a model's residual.
pub(crate) struct NoiseModel {
    /// d₁ … of D = 1 + d₁q⁻¹ + …
    pub d: Vec<f64>,
    /// The variance of its errors.
    pub variance: f64,
    /// The covariance of d.
    pub covariance: DMatrix<f64>,
}

/// The autoregression of signals, its order by Schwarz's criterion among 1 to `most`.
///
/// Source: Schwarz (1978), Ann. Statist. 6(2), 461-464, doi:10.1214/aos/1176344136.
pub(crate) fn noise_model(left: &[Vec<f64>], most: usize) -> Option<NoiseModel> {
    let samples: usize = left.iter().map(Vec::len).sum();
    let most = most.min(samples / 20).max(1);
    let fit = |order: usize| {
        let rows = left.iter().map(|v| v.len().saturating_sub(order)).sum::<usize>().max(1) as f64;
        let (d, squares) = autoregression(left, order)?;
        let criterion =
            rows * (squares / rows).max(f64::MIN_POSITIVE).ln() + order as f64 * rows.ln();
        criterion.is_finite().then_some((
            criterion / rows,
            d,
            squares / (rows - order as f64).max(1.0),
        ))
    };
    let (_, d, variance) = (1..=most).filter_map(fit).min_by(|a, b| a.0.total_cmp(&b.0))?;
    let order = d.len();
    let mut products = DMatrix::zeros(order + 1, order + 1);
    for v in left.iter().filter(|v| v.len() > order) {
        products += lag_matrix(v, None, order, (order + 1, order + 1));
    }
    let covariance = inverse(products.view((1, 1), (order, order)).into_owned())? * variance;
    Some(NoiseModel { d, variance, covariance })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// y = 0.5·q⁻³/(1 − 1.5q⁻¹ + 0.7q⁻²) u + e/(1 − 0.9q⁻¹), where least squares is biased.
    fn record(samples: usize, seed: u64) -> Record<'static> {
        let mut state = seed;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
        };
        let u: Vec<f64> = (0..samples).map(|_| next()).collect();
        let e: Vec<f64> = (0..samples).map(|_| next()).collect();
        let delayed: Vec<f64> =
            (0..samples).map(|t| if t < 3 { 0.0 } else { 0.5 * u[t - 3] }).collect();
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
        let best = (0..7)
            .min_by(|&a, &b| {
                fits[a].as_ref().unwrap().loss.total_cmp(&fits[b].as_ref().unwrap().loss)
            })
            .unwrap();
        let fit = fits[best].as_ref().unwrap();
        assert_eq!((best, fit.converged), (3, true));
        for (got, want) in fit.f.iter().chain(&fit.b).chain(&fit.d).zip([-1.5, 0.7, 0.5, -0.9]) {
            assert!((got - want).abs() < 0.03, "{fit:?}");
        }
        // Uniform errors of width 1.
        assert!((fit.loss * 12.0 - 1.0).abs() < 0.05, "{fit:?}");
    }
}
