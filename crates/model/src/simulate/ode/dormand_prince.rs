//! One step of the explicit Runge-Kutta pair of Dormand and Prince, order 5(4), with its dense output of order 4.
//!
//! Sources: Dormand & Prince 1980, A family of embedded Runge-Kutta formulae. Hairer, Nørsett & Wanner 1993, Solving Ordinary Differential Equations I, II.5
//! (table 5.2), II.6 (dense output), and IV.2 of volume II (stiffness detection).

use super::rhs::Rhs;

const C: [f64; 5] = [1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0];
const A2: [f64; 1] = [1.0 / 5.0];
const A3: [f64; 2] = [3.0 / 40.0, 9.0 / 40.0];
const A4: [f64; 3] = [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0];
const A5: [f64; 4] = [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0];
const A6: [f64; 5] =
    [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0];
/// For stages 1, 3, 4, 5, 6; that of stage 2 is 0.
const B: [f64; 5] = [35.0 / 384.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0];
/// Fifth minus fourth order, for stages 1, 3, 4, 5, 6, 7.
const E: [f64; 6] = [
    71.0 / 57600.0,
    -71.0 / 16695.0,
    71.0 / 1920.0,
    -17253.0 / 339_200.0,
    22.0 / 525.0,
    -1.0 / 40.0,
];
/// Dense output, for stages 1, 3, 4, 5, 6, 7.
const D: [f64; 6] = [
    -12_715_105_075.0 / 11_282_082_432.0,
    87_487_479_700.0 / 32_700_410_799.0,
    -10_690_763_975.0 / 1_880_347_072.0,
    701_980_252_875.0 / 199_316_789_632.0,
    -1_453_857_185.0 / 822_651_844.0,
    69_997_945.0 / 29_380_423.0,
];

/// Slopes of the stages and the corresponding state.
#[derive(Debug, Clone)]
pub(super) struct DormandPrince {
    n: usize,
    /// Seven slopes of n each; the first belongs to the start of the step, the last to its end.
    pub(super) k: Vec<f64>,
    /// The state of the present stage; after a step, of the sixth.
    stage: Vec<f64>,
}

impl DormandPrince {
    pub(super) fn new(n: usize) -> Self {
        Self { n, k: vec![0.0; 7 * n], stage: vec![0.0; n] }
    }

    /// The slope at the start of the step.
    pub(super) fn first(&mut self) -> &mut [f64] {
        &mut self.k[..self.n]
    }

    /// The last slope becomes the first: the next step begins at the end of this one.
    pub(super) fn advance(&mut self) {
        self.k.copy_within(6 * self.n.., 0);
    }

    /// Steps from x by h into `to` (order 5): five evaluations, with a known slope at the start.
    #[inline]
    pub(super) fn step<R: Rhs + ?Sized>(
        &mut self,
        rhs: &mut R,
        t: f64,
        h: f64,
        x: &[f64],
        to: &mut [f64],
    ) {
        // A number of states known at compile time unrolls the loops.
        match self.n {
            2 => self.step_of(2, rhs, t, h, x, to),
            3 => self.step_of(3, rhs, t, h, x, to),
            4 => self.step_of(4, rhs, t, h, x, to),
            n => self.step_of(n, rhs, t, h, x, to),
        }
    }

    #[inline(always)]
    fn step_of<R: Rhs + ?Sized>(
        &mut self,
        n: usize,
        rhs: &mut R,
        t: f64,
        h: f64,
        x: &[f64],
        to: &mut [f64],
    ) {
        let stage = &mut self.stage[..n];
        let (x, to) = (&x[..n], &mut to[..n]);
        let (k1, rest) = self.k.split_at_mut(n);
        let (k2, rest) = rest.split_at_mut(n);
        let (k3, rest) = rest.split_at_mut(n);
        let (k4, rest) = rest.split_at_mut(n);
        let (k5, rest) = rest.split_at_mut(n);
        let k6 = &mut rest[..n];
        for i in 0..n {
            stage[i] = x[i] + h * (A2[0] * k1[i]);
        }
        rhs.eval(t + C[0] * h, stage, k2);
        for i in 0..n {
            stage[i] = x[i] + h * (A3[0] * k1[i] + A3[1] * k2[i]);
        }
        rhs.eval(t + C[1] * h, stage, k3);
        for i in 0..n {
            stage[i] = x[i] + h * (A4[0] * k1[i] + A4[1] * k2[i] + A4[2] * k3[i]);
        }
        rhs.eval(t + C[2] * h, stage, k4);
        for i in 0..n {
            stage[i] = x[i] + h * (A5[0] * k1[i] + A5[1] * k2[i] + A5[2] * k3[i] + A5[3] * k4[i]);
        }
        rhs.eval(t + C[3] * h, stage, k5);
        for i in 0..n {
            stage[i] = x[i]
                + h * (A6[0] * k1[i]
                    + A6[1] * k2[i]
                    + A6[2] * k3[i]
                    + A6[3] * k4[i]
                    + A6[4] * k5[i]);
        }
        rhs.eval(t + C[4] * h, stage, k6);
        for i in 0..n {
            to[i] = x[i]
                + h * (B[0] * k1[i] + B[1] * k3[i] + B[2] * k4[i] + B[3] * k5[i] + B[4] * k6[i]);
        }
    }

    /// The slope at the end of the step (the seventh evaluation), and the error estimate over the tolerance.
    #[inline]
    pub(super) fn finish<R: Rhs + ?Sized>(
        &mut self,
        rhs: &mut R,
        t: f64,
        h: f64,
        x: &[f64],
        to: &[f64],
        tolerance: (f64, f64),
    ) -> f64 {
        rhs.eval(t + h, to, &mut self.k[6 * self.n..]);
        match self.n {
            2 => self.error_of(2, h, x, to, tolerance),
            3 => self.error_of(3, h, x, to, tolerance),
            4 => self.error_of(4, h, x, to, tolerance),
            n => self.error_of(n, h, x, to, tolerance),
        }
    }

    #[inline(always)]
    fn error_of(&self, n: usize, h: f64, x: &[f64], to: &[f64], (rtol, atol): (f64, f64)) -> f64 {
        let (k, x, to) = (&self.k[..7 * n], &x[..n], &to[..n]);
        let mut sum = 0.0;
        for i in 0..n {
            let stage = |s: usize| k[s * n + i];
            let e = E[0] * stage(0)
                + E[1] * stage(2)
                + E[2] * stage(3)
                + E[3] * stage(4)
                + E[4] * stage(5)
                + E[5] * stage(6);
            let scale = atol + rtol * x[i].abs().max(to[i].abs());
            sum += (h * e / scale).powi(2);
        }
        let count = n.max(1) as f64;
        (sum / count).sqrt()
    }

    /// |h λ| of the fastest mode seen, from the last two slopes at the end of the step.
    pub(super) fn stiffness(&self, h: f64, to: &[f64]) -> f64 {
        let n = self.n;
        let slopes: f64 = (0..n).map(|i| (self.k[6 * n + i] - self.k[5 * n + i]).powi(2)).sum();
        let states: f64 = (0..n).map(|i| (to[i] - self.stage[i]).powi(2)).sum();
        if states > 0.0 { h.abs() * (slopes / states).sqrt() } else { 0.0 }
    }

    /// The state at the share θ of the last step from x to `to`.
    pub(super) fn dense(&self, theta: f64, h: f64, x: &[f64], to: &[f64], at: &mut [f64]) {
        let n = self.n;
        let rest = 1.0 - theta;
        for i in 0..n {
            let stage = |s: usize| self.k[s * n + i];
            let difference = to[i] - x[i];
            let start = h * stage(0) - difference;
            let end = difference - h * stage(6) - start;
            let curve = h
                * (D[0] * stage(0)
                    + D[1] * stage(2)
                    + D[2] * stage(3)
                    + D[3] * stage(4)
                    + D[4] * stage(5)
                    + D[5] * stage(6));
            at[i] = x[i] + theta * (difference + rest * (start + theta * (end + rest * curve)));
        }
    }
}
