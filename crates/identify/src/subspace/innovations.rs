//! Models in innovations form of several inputs and outputs, and their regression on states that are known combinations of the past.

use deadtime_model::dlqr;
use nalgebra::{DMatrix, DVector};

use super::recordings::{Factor, Scales, Stretch};
use super::single::{join, solve};

/// x(t+1) = A x + B u + K e, y = C x + D u + e. All signals are deviations from the operating point, in the channels' units.
#[derive(Debug, Clone, PartialEq)]
pub struct InnovationsModel {
    /// n×n.
    pub a: DMatrix<f64>,
    /// n×m.
    pub b: DMatrix<f64>,
    /// l×n.
    pub c: DMatrix<f64>,
    /// l×m.
    pub d: DMatrix<f64>,
    /// n×l, the predictor's gain.
    pub k: DMatrix<f64>,
}

impl InnovationsModel {
    /// Number of states.
    #[must_use]
    pub fn order(&self) -> usize {
        self.a.nrows()
    }

    /// One-step prediction errors, l × samples, from the initial state that fits the record best (least squares).
    #[must_use]
    pub fn innovations(&self, s: &Stretch) -> DMatrix<f64> {
        let mut x = DVector::zeros(self.order());
        let mut e = s.y.clone();
        for t in 0..s.len() {
            let u = s.u.column(t);
            let error = s.y.column(t) - &self.c * &x - &self.d * u;
            x = &self.a * x + &self.b * u + &self.k * &error;
            e.set_column(t, &error);
        }
        self.without_start(&(&self.a - &self.k * &self.c), e)
    }

    /// The errors minus the best-fitting response C·Fᵗ·x₀; unchanged where F does not decay.
    fn without_start(&self, f: &DMatrix<f64>, mut errors: DMatrix<f64>) -> DMatrix<f64> {
        let (n, l) = (self.order(), self.c.nrows());
        let seen = errors.ncols().min(SETTLING);
        let mut gamma = DMatrix::zeros(l * seen, n);
        let mut response = self.c.clone();
        for t in 0..seen {
            gamma.view_mut((t * l, 0), (l, n)).copy_from(&response);
            response *= f;
        }
        if !gamma.iter().all(|v| v.is_finite()) {
            return errors;
        }
        let first = DMatrix::from_fn(l * seen, 1, |row, _| errors[(row % l, row / l)]);
        let (mut start, _) = solve(&gamma, &first, &column_norms(&gamma));
        for t in 0..errors.ncols() {
            let response = &self.c * &start;
            for i in 0..l {
                errors[(i, t)] -= response[(i, 0)];
            }
            start = f * start;
        }
        errors
    }

    /// Outputs of a free run, l × samples, from the state that fits the record best (least squares).
    #[must_use]
    pub fn free_run(&self, s: &Stretch) -> DMatrix<f64> {
        let mut x = DVector::zeros(self.order());
        let mut errors = s.y.clone();
        for t in 0..s.len() {
            let u = s.u.column(t);
            errors.set_column(t, &(s.y.column(t) - &self.c * &x - &self.d * u));
            x = &self.a * x + &self.b * u;
        }
        &s.y - self.without_start(&self.a, errors)
    }

    /// Every entry is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        [&self.a, &self.b, &self.c, &self.d, &self.k]
            .iter()
            .all(|m| m.iter().all(|v| v.is_finite()))
    }

    /// The same model with a decaying predictor. Where A − KC does not decay, K becomes the Kalman gain for the covariances of the residuals. `states` and
    /// `outputs` are residuals of x(t+1) and y(t), `y` the outputs.
    ///
    /// Source: Van Overschee and De Moor (1996), "Subspace Identification for Linear Systems", section 4.5, doi:10.1007/978-1-4613-0465-4.
    fn with_stable_predictor(
        mut self,
        states: &DMatrix<f64>,
        outputs: &DMatrix<f64>,
        y: &DMatrix<f64>,
    ) -> Self {
        if !self.is_finite() || decays(&(&self.a - &self.k * &self.c)) {
            return self;
        }
        let r = outputs.tr_mul(outputs);
        let s = &self.k * &r;
        let q = states.tr_mul(states) + &s * self.k.transpose();
        self.k = self.kalman(&q, &r, &s, y);
        self
    }

    /// The Kalman gain for state and output noises of the covariances Q, R and S, up to a factor. 0 where none exists. `y`: the outputs.
    pub(super) fn kalman(
        &self,
        q: &DMatrix<f64>,
        r: &DMatrix<f64>,
        s: &DMatrix<f64>,
        y: &DMatrix<f64>,
    ) -> DMatrix<f64> {
        let (mut q, mut r) = ((q + q.transpose()) * 0.5, r.clone());
        for (i, column) in y.column_iter().enumerate() {
            r[(i, i)] += ROUNDING * column.norm_squared();
        }
        let size = q.norm();
        for i in 0..q.nrows() {
            q[(i, i)] += ROUNDING * size;
        }
        let filter = dlqr(&self.a.transpose(), &self.c.transpose(), &q, &r, Some(s));
        match filter {
            Ok(filter) => filter.k.transpose(),
            Err(_) if decays(&self.a) => DMatrix::zeros(self.order(), self.c.nrows()),
            Err(_) => self.k.clone(),
        }
    }

    /// The model of scaled deviations, in the channels' own units.
    pub(super) fn in_units(mut self, scales: &Scales) -> Self {
        for (j, (_, su)) in scales.inputs.iter().enumerate() {
            self.b.column_mut(j).scale_mut(1.0 / su);
            self.d.column_mut(j).scale_mut(1.0 / su);
        }
        for (i, (_, sy)) in scales.outputs.iter().enumerate() {
            self.c.row_mut(i).scale_mut(*sy);
            self.d.row_mut(i).scale_mut(*sy);
            self.k.column_mut(i).scale_mut(1.0 / sy);
        }
        self
    }
}

/// Variance of rounding, relative to that of what is rounded.
const ROUNDING: f64 = 1e-20;
/// Squarings that decide whether a matrix decays: 2⁴⁰ samples.
const SQUARINGS: usize = 40;

/// The powers of a matrix converge to 0.
pub(super) fn decays(m: &DMatrix<f64>) -> bool {
    let mut power = m.clone();
    for _ in 0..SQUARINGS {
        if power.norm() < 0.5 {
            return true;
        }
        power = &power * &power;
        if !power.iter().all(|v| v.is_finite()) {
            return false;
        }
    }
    false
}

/// Samples that estimate the initial state of a free run.
const SETTLING: usize = 2000;

pub(super) fn column_norms(m: &DMatrix<f64>) -> Vec<f64> {
    m.column_iter().map(|c| c.norm()).collect()
}

/// Whether the input acts within the sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "snake_case")]
pub enum Direct {
    /// D = 0: correct for sampled plants behind a hold, and required where a controller reacts within the sample.
    #[default]
    None,
    /// D is estimated; requires an input independent of the output of the same sample.
    Free,
}

/// The model whose states are `map` times the past: x(t) = map·[z(t−1); …; z(t−p)]. The residuals y − Cx − Du, in the rows of the factor, are also returned.
///
/// C and D by regression of y(t) on x(t) and u(t). A, B and K by regression of x(t+1) on x(t), u(t) and the residuals.
/// Source: van der Veen et al. (2013), doi:10.1049/iet-cta.2012.0653, section 4.
pub(super) fn of_states(
    factor: &Factor,
    y: &DMatrix<f64>,
    map: &DMatrix<f64>,
    direct: Direct,
) -> (InnovationsModel, DMatrix<f64>) {
    let (layout, n) = (factor.layout, map.nrows());
    let (m, l) = (layout.m, layout.l);
    let u = factor.u();
    let (x, next) = (factor.states(map), factor.next_states(map, y));
    let seen = if direct == Direct::Free { join(&x, &u) } else { x.clone() };
    let (of_output, e) = solve(&seen, y, &column_norms(&seen));
    let moved = join(&join(&x, &u), &e);
    let mut norms = column_norms(&moved);
    // Residuals of rounding size are zero.
    for (norm, column) in norms[n + m..].iter_mut().zip(y.column_iter()) {
        *norm = column.norm();
    }
    let (of_states, left) = solve(&moved, &next, &norms);
    let model = InnovationsModel {
        a: of_states.rows(0, n).transpose(),
        b: of_states.rows(n, m).transpose(),
        c: of_output.rows(0, n).transpose(),
        d: if direct == Direct::Free {
            of_output.rows(n, m).transpose()
        } else {
            DMatrix::zeros(l, m)
        },
        k: of_states.rows(n + m, l).transpose(),
    };
    (model.with_stable_predictor(&left, &e, y), e)
}
