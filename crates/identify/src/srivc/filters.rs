//! Signals through 1/A(p), exact for inputs held between their samples.

use crate::rival::polynomial;
use deadtime_model::exp;
use deadtime_signal::decompositions::eigenvalues;
use nalgebra::{DMatrix, DVector};

/// A(p) = pⁿ + a₁pⁿ⁻¹ + … + aₙ in the time unit 1/ω, ω in rad per sample.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Poles {
    pub(super) omega: f64,
    pub(super) a: Vec<f64>,
}

impl Poles {
    /// (p + 1)ⁿ.
    pub(super) fn equal(omega: f64, order: usize) -> Self {
        let mut a = vec![0.0; order + 1];
        a[0] = 1.0;
        for _ in 0..order {
            for i in (1..a.len()).rev() {
                a[i] += a[i - 1];
            }
        }
        Self { omega, a: a.split_off(1) }
    }

    pub(super) fn order(&self) -> usize {
        self.a.len()
    }

    fn companion(&self) -> DMatrix<f64> {
        let n = self.order();
        DMatrix::from_fn(n, n, |i, j| match i {
            0 => -self.a[j],
            _ => f64::from(u8::from(j + 1 == i)),
        })
    }

    /// All poles are stable.
    pub(super) fn is_stable(&self) -> bool {
        self.a.iter().all(|v| v.is_finite())
            && eigenvalues(&self.companion()).iter().all(|p| p.re < 0.0)
    }

    /// Unstable poles mirrored, with time in units of their geometric mean.
    pub(super) fn settled(&self) -> Option<Self> {
        if !self.a.iter().all(|v| v.is_finite()) {
            return None;
        }
        let poles = eigenvalues(&self.companion());
        let size = poles.iter().map(|p| p.norm().max(SLOWEST).ln()).sum::<f64>();
        let unit = (size / self.order() as f64).exp();
        let mirrored =
            poles.iter().map(|p| nalgebra::Complex::new(-p.re.abs().max(SLOWEST), p.im) / unit);
        Some(Self { omega: self.omega * unit, a: polynomial(mirrored) })
    }

    /// From sampled poles; `None` where one has no logarithm.
    pub(super) fn of_sampled(poles: &[nalgebra::Complex<f64>]) -> Option<Self> {
        let whole = poles.iter().all(|z| z.norm() > 1e-6 && !(z.im == 0.0 && z.re < 0.0));
        let poles = poles.iter().map(|z| z.ln());
        whole.then(|| Self { omega: 1.0, a: polynomial(poles) })?.settled()
    }

    /// The states pⁿ⁻¹/A, …, 1/A of the input `u` delayed by `delay` samples, from rest; u[`from`] is that of the first sample.
    pub(super) fn states(&self, u: &[f64], delay: f64, from: usize) -> Vec<Vec<f64>> {
        let whole = delay.floor();
        let part = delay - whole;
        let late = from.saturating_sub(whole as usize);
        let before = self.held(1.0 - part).0 * self.held(part).1;
        let after = self.held(1.0 - part).1;
        let phi = self.held(1.0).0;
        let drive = |k: usize| {
            let old = (late + k).checked_sub(1).map_or(0.0, |i| u[i]);
            &before * old + &after * u[late + k]
        };
        run(&phi, DVector::zeros(self.order()), u.len() - from, drive)
    }

    /// The states of a signal that is not held: the mean of linear interpolation over each sample.
    pub(super) fn states_of_output(&self, y: &[f64]) -> Vec<Vec<f64>> {
        let (phi, gamma) = self.held(1.0);
        let drive = |k: usize| &gamma * (0.5 * (y[k] + y.get(k + 1).unwrap_or(&y[k])));
        run(&phi, DVector::zeros(self.order()), y.len(), drive)
    }

    /// The n outputs of A(p)·y = 0.
    pub(super) fn free(&self, samples: usize) -> Vec<Vec<f64>> {
        let (n, phi) = (self.order(), self.held(1.0).0);
        let one = |i: usize| {
            let mut start = DVector::zeros(n);
            start[i] = 1.0;
            run(&phi, start, samples, |_| DVector::zeros(n)).pop().unwrap_or_default()
        };
        (0..n).map(one).collect()
    }

    /// e^(A h) and ∫₀ʰ e^(A s) ds·e₁ over h samples.
    fn held(&self, h: f64) -> (DMatrix<f64>, DVector<f64>) {
        let n = self.order();
        let mut all = DMatrix::zeros(n + 1, n + 1);
        all.view_mut((0, 0), (n, n)).copy_from(&self.companion());
        all[(0, n)] = 1.0;
        let e = exp(&(all * (self.omega * h)));
        (e.view((0, 0), (n, n)).into_owned(), e.view((0, n), (n, 1)).column(0).into_owned())
    }
}

/// Smallest magnitude of a pole.
const SLOWEST: f64 = 1e-9;

fn run(
    phi: &DMatrix<f64>,
    mut x: DVector<f64>,
    samples: usize,
    drive: impl Fn(usize) -> DVector<f64>,
) -> Vec<Vec<f64>> {
    let mut out = vec![Vec::with_capacity(samples); x.len()];
    for k in 0..samples {
        for (out, x) in out.iter_mut().zip(x.iter()) {
            out.push(*x);
        }
        x = phi * x + drive(k);
    }
    out
}
