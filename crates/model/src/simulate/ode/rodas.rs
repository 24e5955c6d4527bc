//! One step of RODAS, a stiffly accurate, L-stable Rosenbrock method of order 4(3) with six stages.
//!
//! (1/(hγ) − J) u(i) = f(t + α(i) h, x + Σ a(ij) u(j)) + Σ c(ij)/h u(j) + h γ(i) ∂f/∂t. The last stage is the error estimate.
//! Source: Hairer & Wanner 1996, Solving Ordinary Differential Equations II, IV.7 (coefficients of the code RODAS).

use super::lu;
use super::rhs::Rhs;

const GAMMA: f64 = 0.25;
const ALPHA: [f64; 6] = [0.0, 0.386, 0.21, 0.63, 1.0, 1.0];
const GAMMAS: [f64; 6] = [0.25, -0.1043, 0.1035, -0.0362, 0.0, 0.0];
const A: [&[f64]; 6] = [
    &[],
    &[1.544],
    &[0.946_678_528_081_582_6, 0.255_701_169_898_328_4],
    &[3.314_825_187_068_521, 2.896_124_015_972_201, 0.998_641_913_997_781_7],
    &[1.221_224_509_226_641, 6.019_134_481_288_629, 12.537_083_329_320_87, -0.687_886_036_105_895],
    &[
        1.221_224_509_226_641,
        6.019_134_481_288_629,
        12.537_083_329_320_87,
        -0.687_886_036_105_895,
        1.0,
    ],
];
const C: [&[f64]; 6] = [
    &[],
    &[-5.6688],
    &[-2.430_093_356_833_875, -0.206_359_915_709_191_5],
    &[-0.107_352_905_815_137_5, -9.594_562_251_023_355, -20.470_286_148_096_16],
    &[7.496_443_313_967_647, -10.246_804_314_643_52, -33.999_903_528_199_05, 11.708_908_932_061_6],
    &[
        8.083_246_795_921_522,
        -7.981_132_988_064_893,
        -31.521_594_328_743_71,
        16.319_305_431_231_36,
        -6.058_818_238_834_054,
    ],
];

/// Memory of a step.
#[derive(Debug, Clone)]
pub(super) struct Rodas {
    n: usize,
    pub(super) jacobian: Vec<f64>,
    matrix: Vec<f64>,
    pivots: Vec<usize>,
    slope: Vec<f64>,
    stages: Vec<f64>,
    stage_x: Vec<f64>,
    scratch: Vec<f64>,
}

impl Rodas {
    pub(super) fn new(n: usize) -> Self {
        Self {
            n,
            jacobian: vec![0.0; n * n],
            matrix: vec![0.0; n * n],
            pivots: vec![0; n],
            slope: vec![0.0; n],
            stages: vec![0.0; 6 * n],
            stage_x: vec![0.0; n],
            scratch: vec![0.0; 2 * n],
        }
    }

    /// Jacobian and time slope at the start of a step; `dx` = f(t, x).
    pub(super) fn prepare<R: Rhs + ?Sized>(
        &mut self,
        rhs: &mut R,
        t: f64,
        x: &[f64],
        dx: &[f64],
        h: f64,
    ) {
        self.stage_x.copy_from_slice(x);
        rhs.jacobian(t, &mut self.stage_x, dx, &mut self.scratch, &mut self.jacobian);
        let step = (f64::EPSILON.sqrt() * t.abs().max(h.abs())).min(1e-3 * h.abs());
        rhs.time_slope(t, x, dx, step, &mut self.slope);
    }

    /// The largest row sum of the Jacobian: a bound of its eigenvalues.
    pub(super) fn jacobian_norm(&self) -> f64 {
        let n = self.n;
        (0..n)
            .map(|i| (0..n).map(|j| self.jacobian[i + n * j].abs()).sum::<f64>())
            .fold(0.0, f64::max)
    }

    /// Steps from x by h into `to`; `error` gets the estimate. `false` for a singular matrix or an undefined stage.
    #[allow(clippy::too_many_arguments)]
    pub(super) fn step<R: Rhs + ?Sized>(
        &mut self,
        rhs: &mut R,
        t: f64,
        h: f64,
        x: &[f64],
        dx: &[f64],
        to: &mut [f64],
        error: &mut [f64],
    ) -> bool {
        let n = self.n;
        for (m, j) in self.matrix.iter_mut().zip(&self.jacobian) {
            *m = -j;
        }
        for i in 0..n {
            self.matrix[i + n * i] += 1.0 / (h * GAMMA);
        }
        if !lu::decompose(n, &mut self.matrix, &mut self.pivots) {
            return false;
        }
        for s in 0..6 {
            let (done, rest) = self.stages.split_at_mut(s * n);
            let u = &mut rest[..n];
            if s == 0 {
                u.copy_from_slice(dx);
            } else {
                for i in 0..n {
                    self.stage_x[i] = x[i]
                        + A[s].iter().enumerate().map(|(j, a)| a * done[j * n + i]).sum::<f64>();
                }
                rhs.eval(t + ALPHA[s] * h, &self.stage_x, u);
            }
            for i in 0..n {
                u[i] += C[s].iter().enumerate().map(|(j, c)| c / h * done[j * n + i]).sum::<f64>()
                    + h * GAMMAS[s] * self.slope[i];
            }
            if u.iter().any(|v| !v.is_finite()) {
                return false;
            }
            lu::solve(n, &self.matrix, &self.pivots, u);
        }
        let last = &self.stages[5 * n..];
        for i in 0..n {
            to[i] = self.stage_x[i] + last[i];
            error[i] = last[i];
        }
        true
    }
}
