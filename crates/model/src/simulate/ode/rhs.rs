//! The interface between an integrator and the equations.

/// The right-hand side of dx/dt = f(t, x).
pub trait Rhs {
    /// Number of states.
    fn dim(&self) -> usize;

    /// dx = f(t, x). An undefined value is NaN or infinite: the step is then repeated with a shorter length.
    fn eval(&mut self, t: f64, x: &[f64], dx: &mut [f64]);

    /// ∂f/∂x, column by column: `jacobian[i + n*j]` is ∂f(i)/∂x(j). `dx` is f(t, x), `scratch` has room for two states.
    ///
    /// By default forward differences; x is changed temporarily and restored.
    fn jacobian(
        &mut self,
        t: f64,
        x: &mut [f64],
        dx: &[f64],
        scratch: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let n = x.len();
        let shifted = &mut scratch[..n];
        for j in 0..n {
            let before = x[j];
            let step = f64::EPSILON.sqrt() * before.abs().max(1e-5);
            x[j] = before + step;
            // The actual difference after rounding.
            let made = x[j] - before;
            self.eval(t, x, shifted);
            x[j] = before;
            for i in 0..n {
                jacobian[i + n * j] = (shifted[i] - dx[i]) / made;
            }
        }
    }

    /// ∂f/∂t with x fixed. `dx` is f(t, x) and `step` a time small compared with the next step; by default a forward difference.
    fn time_slope(&mut self, t: f64, x: &[f64], dx: &[f64], step: f64, slope: &mut [f64]) {
        let made = (t + step) - t;
        self.eval(t + made, x, slope);
        for (s, d) in slope.iter_mut().zip(dx) {
            *s = if made == 0.0 { 0.0 } else { (*s - d) / made };
        }
    }
}
