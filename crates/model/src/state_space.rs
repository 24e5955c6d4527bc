//! State-space models. Continuous or sampled is part of the type.

use nalgebra::{Complex, DMatrix, DVector};

use super::error::ModelError;
use super::matrices::Matrices;
use super::shape::check_matrix;
use super::zeros;
use deadtime_signal::time::SampleTime;

/// Continuous time; input delays are seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Continuous;

/// Sampled time; input delays are whole samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sampled(pub SampleTime);

/// The time domain of a model, [`Continuous`] or [`Sampled`].
pub trait TimeDomain: Clone + Copy + std::fmt::Debug + PartialEq {
    /// An input delay: seconds, or whole samples.
    type Delay: Copy + Default + PartialEq + std::fmt::Debug;
    /// The point of the complex plane at a frequency: s = jω, or z = exp(jωTs).
    fn point(self, omega_rad_s: f64) -> Complex<f64>;
    /// The delay in seconds.
    fn delay_s(self, delay: Self::Delay) -> f64;
    /// A pole at this point is stable.
    fn is_stable_pole(self, pole: Complex<f64>) -> bool;
    /// The sample time, s; `None` in continuous time.
    fn sample_time_s(self) -> Option<f64>;
    /// Checks a delay.
    ///
    /// # Errors
    /// [`deadtime_signal::time::TimeError::Delay`] for one that is negative or not finite.
    fn check_delay(self, delay: Self::Delay) -> Result<(), deadtime_signal::time::TimeError>;
}

impl TimeDomain for Continuous {
    type Delay = f64;
    fn point(self, omega_rad_s: f64) -> Complex<f64> {
        Complex::new(0.0, omega_rad_s)
    }
    fn delay_s(self, delay: f64) -> f64 {
        delay
    }
    fn is_stable_pole(self, pole: Complex<f64>) -> bool {
        pole.re < 0.0
    }
    fn sample_time_s(self) -> Option<f64> {
        None
    }
    fn check_delay(self, delay: f64) -> Result<(), deadtime_signal::time::TimeError> {
        if delay.is_finite() && delay >= 0.0 {
            Ok(())
        } else {
            Err(deadtime_signal::time::TimeError::Delay { seconds: delay })
        }
    }
}

impl TimeDomain for Sampled {
    type Delay = usize;
    fn point(self, omega_rad_s: f64) -> Complex<f64> {
        Complex::from_polar(1.0, omega_rad_s * self.0.seconds())
    }
    fn delay_s(self, delay: usize) -> f64 {
        self.0.to_seconds(delay as f64)
    }
    fn is_stable_pole(self, pole: Complex<f64>) -> bool {
        pole.norm() < 1.0
    }
    fn sample_time_s(self) -> Option<f64> {
        Some(self.0.seconds())
    }
    fn check_delay(self, _: usize) -> Result<(), deadtime_signal::time::TimeError> {
        Ok(())
    }
}

/// A linear model with a delay at each input. ẋ = A x + B u or x(k+1) = A x(k) + B u(k), y = C x + D u.
///
/// Shapes: A n×n, B n×m, C p×n, D p×m; n may be 0 (a gain).
#[derive(Debug, Clone, PartialEq)]
pub struct StateSpace<T: TimeDomain> {
    a: DMatrix<f64>,
    b: DMatrix<f64>,
    c: DMatrix<f64>,
    d: DMatrix<f64>,
    input_delay: Vec<T::Delay>,
    domain: T,
}

impl StateSpace<Continuous> {
    /// A continuous model without delay.
    ///
    /// # Errors
    /// [`ModelError::Shape`] or [`ModelError::NotFinite`].
    pub fn continuous(
        a: DMatrix<f64>,
        b: DMatrix<f64>,
        c: DMatrix<f64>,
        d: DMatrix<f64>,
    ) -> Result<Self, ModelError> {
        Self::new(a, b, c, d, Continuous)
    }
}

impl StateSpace<Sampled> {
    /// A sampled model without delay.
    ///
    /// # Errors
    /// [`ModelError::Shape`] or [`ModelError::NotFinite`].
    pub fn sampled(
        a: DMatrix<f64>,
        b: DMatrix<f64>,
        c: DMatrix<f64>,
        d: DMatrix<f64>,
        sample_time: SampleTime,
    ) -> Result<Self, ModelError> {
        Self::new(a, b, c, d, Sampled(sample_time))
    }

    /// The sample time.
    #[must_use]
    pub fn sample_time(&self) -> SampleTime {
        self.domain.0
    }

    /// The same model without delays. Every sample of delay becomes a state with a pole at z = 0, behind the states of the model.
    ///
    /// # Errors
    /// None for a valid model.
    pub fn with_delays_as_states(&self) -> Result<Self, ModelError> {
        let (n, m, p) = (self.order(), self.inputs(), self.outputs());
        let total = n + self.input_delay.iter().sum::<usize>();
        let (mut a, mut b) = (DMatrix::zeros(total, total), DMatrix::zeros(total, m));
        let (mut c, mut d) = (DMatrix::zeros(p, total), DMatrix::zeros(p, m));
        a.view_mut((0, 0), (n, n)).copy_from(&self.a);
        c.view_mut((0, 0), (p, n)).copy_from(&self.c);
        let mut at = n;
        for (j, &delay) in self.input_delay.iter().enumerate() {
            let (into_states, into_outputs) = (self.b.column(j), self.d.column(j));
            if delay == 0 {
                b.set_column(j, &into_states.clone_owned().resize_vertically(total, 0.0));
                d.set_column(j, &into_outputs);
                continue;
            }
            // The input enters the first cell of a chain, the last one drives the model.
            b[(at, j)] = 1.0;
            for i in at + 1..at + delay {
                a[(i, i - 1)] = 1.0;
            }
            at += delay;
            a.view_mut((0, at - 1), (n, 1)).copy_from(&into_states);
            c.set_column(at - 1, &into_outputs);
        }
        Self::new(a, b, c, d, self.domain)
    }
}

impl<T: TimeDomain> StateSpace<T> {
    /// A model in the given time domain, without delay.
    ///
    /// # Errors
    /// [`ModelError::Shape`] or [`ModelError::NotFinite`].
    pub fn new(
        a: DMatrix<f64>,
        b: DMatrix<f64>,
        c: DMatrix<f64>,
        d: DMatrix<f64>,
        domain: T,
    ) -> Result<Self, ModelError> {
        let (n, m, p) = (a.nrows(), d.ncols(), d.nrows());
        for (matrix, got, rows, columns) in
            [("A", &a, n, n), ("B", &b, n, m), ("C", &c, p, n), ("D", &d, p, m)]
        {
            check_matrix(matrix, got, (rows, columns))?;
        }
        Ok(Self { a, b, c, d, input_delay: vec![T::Delay::default(); m], domain })
    }

    /// The same model with these delays, one per input: seconds if continuous, whole samples if sampled.
    ///
    /// # Errors
    /// [`ModelError::Count`] for another number of delays, [`ModelError::Time`] for a negative or infinite one.
    pub fn with_input_delay(mut self, input_delay: Vec<T::Delay>) -> Result<Self, ModelError> {
        if input_delay.len() != self.inputs() {
            return Err(ModelError::Count {
                what: "input delays",
                needed: self.inputs(),
                got: input_delay.len(),
            });
        }
        for &delay in &input_delay {
            self.domain.check_delay(delay)?;
        }
        self.input_delay = input_delay;
        Ok(self)
    }

    /// A, n×n.
    #[must_use]
    pub fn a(&self) -> &DMatrix<f64> {
        &self.a
    }
    /// B, n×m.
    #[must_use]
    pub fn b(&self) -> &DMatrix<f64> {
        &self.b
    }
    /// C, p×n.
    #[must_use]
    pub fn c(&self) -> &DMatrix<f64> {
        &self.c
    }
    /// D, p×m.
    #[must_use]
    pub fn d(&self) -> &DMatrix<f64> {
        &self.d
    }
    /// The delay at each input.
    #[must_use]
    pub fn input_delay(&self) -> &[T::Delay] {
        &self.input_delay
    }
    /// Continuous or sampled.
    #[must_use]
    pub fn domain(&self) -> T {
        self.domain
    }
    /// Number of states.
    #[must_use]
    pub fn order(&self) -> usize {
        self.a.nrows()
    }
    /// Number of inputs.
    #[must_use]
    pub fn inputs(&self) -> usize {
        self.d.ncols()
    }
    /// Number of outputs.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.d.nrows()
    }

    /// The model of one input-output pair with all states.
    ///
    /// # Errors
    /// [`ModelError::Index`].
    pub fn pair(&self, output: usize, input: usize) -> Result<Self, ModelError> {
        self.check(output, input)?;
        Ok(Self {
            a: self.a.clone(),
            b: self.b.columns(input, 1).into_owned(),
            c: self.c.rows(output, 1).into_owned(),
            d: self.d.view((output, input), (1, 1)).into_owned(),
            input_delay: vec![self.input_delay[input]],
            domain: self.domain,
        })
    }

    fn check(&self, output: usize, input: usize) -> Result<(), ModelError> {
        if input >= self.inputs() {
            return Err(ModelError::Index { what: "input", index: input, count: self.inputs() });
        }
        if output >= self.outputs() {
            return Err(ModelError::Index { what: "output", index: output, count: self.outputs() });
        }
        Ok(())
    }

    /// The poles, eigenvalues of A, without those of delays.
    #[must_use]
    pub fn poles(&self) -> Vec<Complex<f64>> {
        zeros::eigenvalues(&self.a)
    }

    /// The invariant zeros of the whole model, without those of delays.
    ///
    /// Source: Emami-Naeini and Van Dooren (1982), Automatica 18(4), 415-430, doi:10.1016/0005-1098(82)90070-X.
    #[must_use]
    pub fn zeros(&self) -> Vec<Complex<f64>> {
        zeros::invariant_zeros(Matrices::of(self))
    }

    /// All poles are stable.
    #[must_use]
    pub fn is_stable(&self) -> bool {
        self.poles().into_iter().all(|p| self.domain.is_stable_pole(p))
    }

    /// Poles minus zeros of one pair's transfer function, without delays: the index of its first nonzero Markov parameter (D, C·B, C·A·B, …). `None` where the
    /// transfer function is identically zero or the pair does not exist.
    #[must_use]
    pub fn relative_degree(&self, output: usize, input: usize) -> Option<usize> {
        self.leading_markov(output, input).map(|(degree, _)| degree)
    }

    /// The first nonzero Markov parameter and its index.
    pub fn leading_markov(&self, output: usize, input: usize) -> Option<(usize, f64)> {
        self.check(output, input).ok()?;
        if self.d[(output, input)] != 0.0 {
            return Some((0, self.d[(output, input)]));
        }
        let c = self.c.row(output).transpose();
        let mut x: DVector<f64> = self.b.column(input).into_owned();
        for degree in 1..=self.order() {
            let h = c.dot(&x);
            // The rounding error of a sum of these terms.
            let rounding: f64 =
                c.iter().zip(x.iter()).map(|(c, x)| (c * x).abs()).sum::<f64>() * 1e-12;
            if h.abs() > rounding {
                return Some((degree, h));
            }
            x = &self.a * x;
        }
        None
    }

    /// The Markov parameter of this index: D, C·B, C·A·B, …
    pub(super) fn markov(&self, output: usize, input: usize, index: usize) -> f64 {
        if index == 0 {
            return self.d[(output, input)];
        }
        let mut x: DVector<f64> = self.b.column(input).into_owned();
        for _ in 1..index {
            x = &self.a * x;
        }
        self.c.row(output).transpose().dot(&x)
    }

    /// The frequency response at one frequency, delays included: p×m.
    #[must_use]
    pub fn frequency_response(&self, omega_rad_s: f64) -> DMatrix<Complex<f64>> {
        let n = self.order();
        let point = self.domain.point(omega_rad_s);
        let resolvent = DMatrix::from_fn(n, n, |i, j| {
            Complex::new(-self.a[(i, j)], 0.0) + if i == j { point } else { Complex::default() }
        });
        let complex = |m: &DMatrix<f64>| m.map(|v| Complex::new(v, 0.0));
        let mut response = complex(&self.d);
        if n > 0 {
            match resolvent.lu().solve(&complex(&self.b)) {
                Some(x) => response += complex(&self.c) * x,
                None => response.fill(Complex::new(f64::INFINITY, 0.0)),
            }
        }
        for (mut column, &delay) in response.column_iter_mut().zip(&self.input_delay) {
            column *= Complex::from_polar(1.0, -omega_rad_s * self.domain.delay_s(delay));
        }
        response
    }

    /// The closed loop with u = r − K x, from r: A − B K, C − D K. K is m×n.
    ///
    /// The feedback acts behind the input delay, which therefore delays the reference only.
    ///
    /// # Errors
    /// [`ModelError::Shape`] for another shape of K.
    pub fn with_state_feedback(&self, k: &DMatrix<f64>) -> Result<Self, ModelError> {
        if k.shape() != (self.inputs(), self.order()) {
            let ((got_rows, got_columns), matrix) = (k.shape(), "K");
            let (rows, columns) = (self.inputs(), self.order());
            return Err(ModelError::Shape { matrix, rows, columns, got_rows, got_columns });
        }
        let (a, c) = (&self.a - &self.b * k, &self.c - &self.d * k);
        Self::new(a, self.b.clone(), c, self.d.clone(), self.domain)?
            .with_input_delay(self.input_delay.clone())
    }
}

impl Matrices {
    pub(super) fn of<T: TimeDomain>(sys: &StateSpace<T>) -> Self {
        Self { a: sys.a().clone(), b: sys.b().clone(), c: sys.c().clone(), d: sys.d().clone() }
    }
}
