//! Starts of the search: filtered least squares at several corners, refined by instruments.
//!
//! Source: Young and Jakeman (1980), "Refined instrumental variable methods of recursive time-series analysis. Part III. Extensions", Int. J. Control 31(4),
//! 741-764, doi:10.1080/00207178008961080; Garnier, Mensler and Richard (2003), Int. J. Control 76(13), 1337-1357, doi:10.1080/0020717031000149636.

use nalgebra::{DMatrix, DVector};

use super::filters::Poles;
use super::point::{Data, Point};
use crate::regression::dot;

/// Corner frequencies, a factor of two apart, from the Nyquist frequency down.
const CORNERS: i32 = 11;
/// Rounds of refinement.
const ROUNDS: usize = 8;
/// A change of the coefficients that counts as converged.
const SETTLED: f64 = 1e-4;

impl Data {
    /// Poles by filtered least squares, at the corner frequency of least loss.
    pub(super) fn start(&self, order: usize, delays: &[f64]) -> Option<(f64, Point)> {
        let longest = self.outputs.iter().map(Vec::len).max().unwrap_or(0) as f64;
        let corners = (0..CORNERS).map(|k| std::f64::consts::PI * 0.5f64.powi(k + 1));
        let starts = corners.filter(|c| c * longest > 6.0).filter_map(|corner| {
            let filter = Poles::equal(corner, order);
            let poles = self.regressed(&filter, delays, None)?.settled()?;
            let point = Point { poles, delays: delays.to_vec() };
            Some((self.projected(&point)?.loss, point))
        });
        starts.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// The rounds of refined instrumental variables, and the best of them.
    pub(super) fn refined(&self, mut point: Point) -> Option<(f64, Point)> {
        let mut best: Option<(f64, Point)> = None;
        for _ in 0..ROUNDS {
            let Some(found) = self.projected(&point) else { break };
            if best.as_ref().is_none_or(|(loss, _)| found.loss < *loss) {
                best = Some((found.loss, point.clone()));
            }
            let Some(next) = self.regressed(&point.poles, &point.delays, Some(&found.forced))
            else {
                break;
            };
            let change =
                next.a.iter().zip(&point.poles.a).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            let Some(poles) = next.settled() else { break };
            point.poles = poles;
            if change <= SETTLED {
                break;
            }
        }
        best
    }

    /// A by regression of pⁿ·y on the lower derivatives of y and on those of u, all filtered. With a `model` its output gives the instruments for y.
    fn regressed(&self, filter: &Poles, delays: &[f64], model: Option<&[f64]>) -> Option<Poles> {
        let n = filter.order();
        let own = self.bases(filter);
        let point = Point { poles: filter.clone(), delays: delays.to_vec() };
        let stacked = |signal: &[f64]| -> (Vec<Vec<f64>>, Vec<f64>) {
            let mut states = vec![Vec::with_capacity(signal.len()); n];
            let mut from = 0;
            for y in &self.outputs {
                let part = filter.states_of_output(&signal[from..from + y.len()]);
                from += y.len();
                states.iter_mut().zip(&part).for_each(|(all, s)| all.extend_from_slice(s));
            }
            let highest = |t: usize| {
                signal[t] - filter.a.iter().zip(&states).map(|(a, x)| a * x[t]).sum::<f64>()
            };
            let highest = (0..signal.len()).map(highest).collect();
            (states, highest)
        };
        let (states, highest) = stacked(&self.outputs.concat());
        let instruments = model.map_or_else(|| states.clone(), |model| stacked(model).0);
        let inputs: Vec<DVector<f64>> =
            self.columns(&point).iter().map(|c| self.beyond(&own, c)).collect();
        let with = |own_states: &[Vec<f64>]| -> Vec<DVector<f64>> {
            let outputs = own_states.iter().map(|s| -self.beyond(&own, s));
            outputs.chain(inputs.iter().cloned()).collect()
        };
        let (regressors, instruments) = (with(&states), with(&instruments));
        let target = self.beyond(&own, &highest);
        let k = regressors.len();
        let product = |a: &DVector<f64>, b: &DVector<f64>| dot(a.as_slice(), b.as_slice());
        let size: Vec<f64> = regressors.iter().map(|c| c.norm().max(f64::MIN_POSITIVE)).collect();
        let gram = DMatrix::from_fn(k, k, |i, j| {
            product(&instruments[i], &regressors[j]) / (size[i] * size[j])
        });
        let right = DVector::from_fn(k, |i, _| product(&instruments[i], &target) / size[i]);
        let found = gram.lu().solve(&right)?;
        let a: Vec<f64> = (0..n).map(|i| found[i] / size[i]).collect();
        a.iter().all(|v| v.is_finite()).then_some(Poles { omega: filter.omega, a })
    }
}
