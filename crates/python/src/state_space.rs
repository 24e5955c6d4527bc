//! Linear systems: [`deadtime::model`]'s state-space models and transfer functions, continuous and sampled in one class each.

use nalgebra::{Complex, DMatrix};
use numpy::{Complex64, IntoPyArray, PyArray1, PyArray2, PyArrayDyn, PyArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;

use super::convert::{Table, array1, array2, matrix, vector};
use super::error::{OrRaise, raise};
use super::work::long;
use deadtime::model::{
    Continuous, ModelError, Sampled, StateSpace as Inner, TimeDomain,
    TransferFunction as InnerTransfer,
};
use deadtime::time::{SampleTime, TimeError};

/// Continuous or sampled, distinguished when the program runs.
#[derive(Clone, PartialEq)]
pub(super) enum Either<C, S> {
    Continuous(C),
    Sampled(S),
}

/// The same expression for both.
macro_rules! each {
    ($either:expr, $inner:ident => $body:expr) => {
        match $either {
            Either::Continuous($inner) => $body,
            Either::Sampled($inner) => $body,
        }
    };
}

/// The same conversion of both, each to its own kind.
macro_rules! map {
    ($either:expr, $inner:ident => $body:expr) => {
        match $either {
            Either::Continuous($inner) => Either::Continuous($body),
            Either::Sampled($inner) => Either::Sampled($body),
        }
    };
}

type System = Either<Inner<Continuous>, Inner<Sampled>>;
type Transfer = Either<InnerTransfer<Continuous>, InnerTransfer<Sampled>>;

/// A linear model, dx/dt = A x + B u or x[k+1] = A x[k] + B u[k], y = C x + D u, with a delay at each input.
///
/// Parameters
/// ----------
/// A, B, C, D : array_like, shapes (n, n), (n, m), (p, n), (p, m)
///     The matrices; n may be 0 (a gain). A number stands for a matrix of one entry, and None for a D of zeros.
/// sample_time : float, optional
///     s. None: continuous time.
/// input_delay : float or array_like, shape (m,), optional
///     s, of every input; multiples of the sample time for a sampled model.
///
/// Raises
/// ------
/// ModelError
///     Matrices that do not fit each other or hold NaN or infinity; a delay between two samples of a sampled model.
/// TimeError
///     A sample time or delay that cannot be.
#[pyclass(frozen, module = "deadtime", name = "StateSpace")]
#[derive(Clone)]
pub(super) struct StateSpace(pub(super) System);

#[pymethods]
impl StateSpace {
    #[new]
    #[pyo3(signature = (A, B, C, D = None, sample_time = None, input_delay = None))]
    #[allow(non_snake_case)]
    fn new(
        py: Python<'_>,
        A: &Bound<'_, PyAny>,
        B: &Bound<'_, PyAny>,
        C: &Bound<'_, PyAny>,
        D: Option<&Bound<'_, PyAny>>,
        sample_time: Option<f64>,
        input_delay: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let (a, b, c) = (table("A", A)?, table("B", B)?, table("C", C)?);
        let d = match D {
            None => DMatrix::zeros(c.nrows(), b.ncols()),
            Some(d) => table("D", d)?,
        };
        let inputs = d.ncols();
        let delays = match input_delay {
            None => vec![0.0; inputs],
            Some(delay) => match numbers("input_delay", delay)?.as_slice() {
                &[one] => vec![one; inputs],
                many => many.to_vec(),
            },
        };
        Ok(Self(match sample_time {
            None => Either::Continuous(
                Inner::continuous(a, b, c, d)
                    .and_then(|sys| sys.with_input_delay(delays))
                    .or_raise(py)?,
            ),
            Some(seconds) => {
                let ts = SampleTime::new(seconds).or_raise(py)?;
                let whole =
                    delays.iter().map(|&delay| samples(py, ts, delay)).collect::<PyResult<_>>()?;
                Either::Sampled(
                    Inner::sampled(a, b, c, d, ts)
                        .and_then(|sys| sys.with_input_delay(whole))
                        .or_raise(py)?,
                )
            }
        }))
    }

    /// The matrix A, shape (n, n).
    #[getter]
    #[allow(non_snake_case)]
    fn A<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, each!(&self.0, sys => sys.a().clone()))
    }

    /// The matrix B, shape (n, m).
    #[getter]
    #[allow(non_snake_case)]
    fn B<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, each!(&self.0, sys => sys.b().clone()))
    }

    /// The matrix C, shape (p, n).
    #[getter]
    #[allow(non_snake_case)]
    fn C<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, each!(&self.0, sys => sys.c().clone()))
    }

    /// The matrix D, shape (p, m).
    #[getter]
    #[allow(non_snake_case)]
    fn D<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, each!(&self.0, sys => sys.d().clone()))
    }

    /// The sample time, s; None for continuous time.
    #[getter]
    fn sample_time(&self) -> Option<f64> {
        match &self.0 {
            Either::Continuous(_) => None,
            Either::Sampled(sys) => Some(sys.sample_time().seconds()),
        }
    }

    /// The delay at each input, s, shape (m,).
    #[getter]
    fn input_delay<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, self.delays())
    }

    /// Number of states n.
    #[getter]
    fn order(&self) -> usize {
        each!(&self.0, sys => sys.order())
    }

    /// Number of inputs m.
    #[getter]
    fn inputs(&self) -> usize {
        each!(&self.0, sys => sys.inputs())
    }

    /// Number of outputs p.
    #[getter]
    fn outputs(&self) -> usize {
        each!(&self.0, sys => sys.outputs())
    }

    /// The poles, eigenvalues of A, delays aside: complex, shape (n,).
    fn poles<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<Complex64>> {
        each!(&self.0, sys => sys.poles()).into_pyarray(py)
    }

    /// The invariant zeros of the whole model, delays aside: complex.
    ///
    /// Source: Emami-Naeini and Van Dooren (1982), Automatica 18(4), 415-430, doi:10.1016/0005-1098(82)90070-X.
    fn zeros<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<Complex64>> {
        each!(&self.0, sys => sys.zeros()).into_pyarray(py)
    }

    /// Every pole decays.
    #[getter]
    fn is_stable(&self) -> bool {
        each!(&self.0, sys => sys.is_stable())
    }

    /// Poles minus zeros of one pair's transfer function, delays aside: the index of its first Markov parameter that is not 0. None where the transfer
    /// function is zero. `output` and `input` are counted from 0.
    #[pyo3(signature = (output = 0, input = 0))]
    fn relative_degree(
        &self,
        py: Python<'_>,
        output: usize,
        input: usize,
    ) -> PyResult<Option<usize>> {
        self.check_pair(py, output, input)?;
        Ok(each!(&self.0, sys => sys.relative_degree(output, input)))
    }

    /// The frequency response, delays included.
    ///
    /// Parameters
    /// ----------
    /// omega : float or array_like, shape (K,)
    ///     Angular frequencies, rad/s.
    ///
    /// Returns
    /// -------
    /// array of complex, shape (p, m, K), or (p, m) for one number
    ///     Infinite at a pole.
    fn frequency_response<'py>(
        &self,
        py: Python<'py>,
        omega: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArrayDyn<Complex64>>> {
        let (omegas, single) = frequencies(omega)?;
        let (p, m) = (self.outputs(), self.inputs());
        let mut values = Vec::with_capacity(p * m * omegas.len());
        for &omega in &omegas {
            values
                .extend_from_slice(each!(&self.0, sys => sys.frequency_response(omega)).as_slice());
        }
        let shape = if single { vec![p, m] } else { vec![p, m, omegas.len()] };
        values
            .into_pyarray(py)
            .reshape_with_order(shape, numpy::npyffi::NPY_ORDER::NPY_FORTRANORDER)
    }

    /// The response to a constant, shape (p, m): infinite where a pair integrates it.
    fn dc_gain<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        array2(py, each!(&self.0, sys => sys.dc_gain()))
    }

    /// The H-infinity norm: the largest gain over all frequencies and directions, and the frequency where it is, rad/s.
    ///
    /// Returns
    /// -------
    /// tuple of float
    ///     Norm and frequency; (inf, nan) for a system with a pole that does not decay.
    ///
    /// Notes
    /// -----
    /// Bruinsma and Steinbuch (1990), Systems & Control Letters 14(4), 287-293, doi:10.1016/0167-6911(90)90049-Z; accurate to 1e-10, relatively.
    fn norm_hinf(&self) -> (f64, f64) {
        let peak = each!(&self.0, sys => sys.norm_hinf());
        (peak.gain, peak.omega_rad_s)
    }

    /// The model of one input and one output, all states kept; counted from 0.
    #[pyo3(signature = (output = 0, input = 0))]
    fn select(&self, py: Python<'_>, output: usize, input: usize) -> PyResult<Self> {
        Ok(Self(map!(&self.0, sys => sys.pair(output, input).or_raise(py)?)))
    }

    /// The transfer function of one pair, as it stands (nothing cancelled); outputs and inputs are counted from 0.
    #[pyo3(signature = (output = 0, input = 0))]
    fn transfer_function(
        &self,
        py: Python<'_>,
        output: usize,
        input: usize,
    ) -> PyResult<TransferFunction> {
        let of = map!(&self.0, sys => sys.transfer_function(output, input).or_raise(py)?);
        Ok(TransferFunction(of))
    }

    /// The same sampled model with every sample of its input delays as a state, a pole at z = 0.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     The model is continuous: its delays have no states.
    fn with_delays_as_states(&self, py: Python<'_>) -> PyResult<Self> {
        match &self.0 {
            Either::Continuous(_) if self.delays().iter().all(|d| *d == 0.0) => Ok(self.clone()),
            Either::Continuous(_) => Err(PyValueError::new_err(
                "a delay in continuous time has no states: convert the model with c2d first, or approximate the delay, as by control.pade",
            )),
            Either::Sampled(sys) => {
                Ok(Self(Either::Sampled(sys.with_delays_as_states().or_raise(py)?)))
            }
        }
    }

    /// The responses to a step of each input, from rest, on a grid: the arrays time (N,) and y (N, p, m).
    fn _step_response<'py>(
        &self,
        py: Python<'py>,
        sample_time: Option<f64>,
        samples: usize,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.responses(py, sample_time, samples, Shape::Step)
    }

    /// The same of an impulse.
    fn _impulse_response<'py>(
        &self,
        py: Python<'py>,
        sample_time: Option<f64>,
        samples: usize,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        self.responses(py, sample_time, samples, Shape::Impulse)
    }

    /// The response to a step of each input, `duration` s long and `sample_time` s apart, as of `deadtime.step_response`.
    #[pyo3(signature = (duration = None, sample_time = None))]
    fn step_response<'py>(
        slf: &Bound<'py, Self>,
        duration: Option<f64>,
        sample_time: Option<f64>,
    ) -> PyResult<Bound<'py, PyAny>> {
        models(slf.py(), "step_response")?.call1((slf, duration, sample_time))
    }

    /// The response to an impulse at each input, `duration` s long and `sample_time` s apart, as of `deadtime.impulse_response`.
    #[pyo3(signature = (duration = None, sample_time = None))]
    fn impulse_response<'py>(
        slf: &Bound<'py, Self>,
        duration: Option<f64>,
        sample_time: Option<f64>,
    ) -> PyResult<Bound<'py, PyAny>> {
        models(slf.py(), "impulse_response")?.call1((slf, duration, sample_time))
    }

    /// The system as a `control.StateSpace`, as of `deadtime.to_control`.
    fn to_control<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        models(slf.py(), "to_control")?.call1((slf,))
    }

    /// The system as a `scipy.signal.StateSpace`, as of `deadtime.to_scipy`.
    fn to_scipy<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        models(slf.py(), "to_scipy")?.call1((slf,))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.0 == other.0
    }

    fn __repr__(&self) -> String {
        let (n, m, p) = (self.order(), self.inputs(), self.outputs());
        let mut text = format!(
            "<StateSpace: {}, {}, {}, {}",
            time(self.sample_time()),
            count(n, "state"),
            count(m, "input"),
            count(p, "output")
        );
        if let Some(delays) = self.delays_text() {
            text += &format!(", input delay {delays} s");
        }
        if n + m.max(p) <= SMALL {
            each!(&self.0, sys => for (name, matrix) in [("A", sys.a()), ("B", sys.b()), ("C", sys.c()), ("D", sys.d())] {
                text += &format!("\n  {name} = {}", rows(matrix));
            });
        }
        text + ">"
    }

    /// The equations, for notebooks; None for a model too large to be read.
    fn _repr_latex_(&self) -> Option<String> {
        if self.order() + self.inputs().max(self.outputs()) > 2 * SMALL {
            return None;
        }
        let (x, at) = match &self.0 {
            Either::Continuous(_) => (r"\dot x", "(t)"),
            Either::Sampled(_) => ("x[k+1]", "[k]"),
        };
        let delay = self
            .delays_text()
            .map_or_else(String::new, |d| format!(r",\quad \tau = {d}\,\mathrm{{s}}"));
        let matrices = each!(&self.0, sys => [sys.a(), sys.b(), sys.c(), sys.d()].map(latex));
        let [a, b, c, d] = matrices;
        let samples = self
            .sample_time()
            .map_or_else(String::new, |ts| format!(r",\quad T_s = {}\,\mathrm{{s}}", short(ts)));
        Some(format!(
            r"$$\begin{{aligned}} {x} &= {a}\,x{at} + {b}\,u{at} \\ y{at} &= {c}\,x{at} + {d}\,u{at}{samples}{delay} \end{{aligned}}$$"
        ))
    }

    /// Pickles by its matrices.
    #[allow(clippy::type_complexity)]
    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(
        Bound<'py, PyAny>,
        (
            Bound<'py, PyAny>,
            Bound<'py, PyAny>,
            Bound<'py, PyAny>,
            Bound<'py, PyAny>,
            Option<f64>,
            Bound<'py, PyAny>,
        ),
    )> {
        let (py, sys) = (slf.py(), slf.get());
        let arguments = (
            sys.A(py)?.into_any(),
            sys.B(py)?.into_any(),
            sys.C(py)?.into_any(),
            sys.D(py)?.into_any(),
            sys.sample_time(),
            sys.input_delay(py).into_any(),
        );
        Ok((slf.get_type().into_any(), arguments))
    }
}

/// Which response.
#[derive(Clone, Copy)]
enum Shape {
    Step,
    Impulse,
}

impl StateSpace {
    fn check_pair(&self, py: Python<'_>, output: usize, input: usize) -> PyResult<()> {
        for (what, index, count) in
            [("input", input, self.inputs()), ("output", output, self.outputs())]
        {
            if index >= count {
                return Err(raise(py, ModelError::Index { what, index, count }));
            }
        }
        Ok(())
    }

    /// Seconds.
    pub(super) fn delays(&self) -> Vec<f64> {
        each!(&self.0, sys => sys.input_delay().iter().map(|&d| sys.domain().delay_s(d)).collect())
    }

    /// The delays, one number where all are the same; None where there are none.
    fn delays_text(&self) -> Option<String> {
        let delays = self.delays();
        let first = *delays.first()?;
        match delays.iter().all(|d| *d == first) {
            true => (first > 0.0).then(|| short(first)),
            false => Some(list(delays.iter())),
        }
    }

    fn responses<'py>(
        &self,
        py: Python<'py>,
        sample_time: Option<f64>,
        samples: usize,
        shape: Shape,
    ) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
        use deadtime::simulate::{
            impulse_response, impulse_response_sampled, step_response, step_response_sampled,
        };
        let system = self.0.clone();
        let (p, m) = (self.outputs(), self.inputs());
        let columns = long(py, None, move |_| {
            Ok(match &system {
                Either::Continuous(sys) => {
                    let ts = SampleTime::new(sample_time.unwrap_or(f64::NAN))?;
                    match shape {
                        Shape::Step => step_response(sys, ts, samples)?,
                        Shape::Impulse => impulse_response(sys, ts, samples)?,
                    }
                }
                Either::Sampled(sys) => {
                    if let Some(seconds) = sample_time {
                        sys.sample_time().must_equal(SampleTime::new(seconds)?)?;
                    }
                    match shape {
                        Shape::Step => step_response_sampled(sys, samples)?,
                        Shape::Impulse => impulse_response_sampled(sys, samples)?,
                    }
                }
            })
        })?;
        let mut values = Vec::with_capacity(samples * p * m);
        for column in &columns {
            values.extend_from_slice(column.as_slice());
        }
        values
            .into_pyarray(py)
            .reshape_with_order(vec![samples, p, m], numpy::npyffi::NPY_ORDER::NPY_FORTRANORDER)
    }
}

/// A transfer function of one input and one output, kept as zeros, poles, gain and delay, which lose less to rounding than coefficients.
///
/// Parameters
/// ----------
/// num, den : array_like
///     Coefficients in s or z, highest power first.
/// sample_time : float, optional
///     s. None: continuous time.
/// delay : float
///     s; a multiple of the sample time for a sampled one.
///
/// Raises
/// ------
/// ModelError
///     More zeros than poles; coefficients that are not finite, or a denominator of zeros.
#[pyclass(frozen, module = "deadtime", name = "TransferFunction")]
#[derive(Clone)]
pub(super) struct TransferFunction(pub(super) Transfer);

#[pymethods]
impl TransferFunction {
    #[new]
    #[pyo3(signature = (num, den, sample_time = None, delay = 0.0))]
    fn new(
        py: Python<'_>,
        num: &Bound<'_, PyAny>,
        den: &Bound<'_, PyAny>,
        sample_time: Option<f64>,
        delay: f64,
    ) -> PyResult<Self> {
        let (num, den) = (numbers("num", num)?, numbers("den", den)?);
        Ok(Self(map!(domain(py, sample_time, delay)?, at => {
            InnerTransfer::from_polynomials(&num, &den, at.0, at.1).or_raise(py)?
        })))
    }

    /// From `zeros`, `poles` (complex ones in conjugate pairs) and `gain`, the ratio of the leading coefficients; `sample_time` and `delay` as of the class.
    #[staticmethod]
    #[pyo3(signature = (zeros, poles, gain, sample_time = None, delay = 0.0))]
    fn from_zeros_poles_gain(
        py: Python<'_>,
        zeros: &Bound<'_, PyAny>,
        poles: &Bound<'_, PyAny>,
        gain: f64,
        sample_time: Option<f64>,
        delay: f64,
    ) -> PyResult<Self> {
        let (zeros, poles) = (roots("zeros", zeros)?, roots("poles", poles)?);
        Ok(Self(map!(domain(py, sample_time, delay)?, at => {
            InnerTransfer::from_zeros_poles_gain(zeros, poles, gain, at.0, at.1).or_raise(py)?
        })))
    }

    /// The zeros: complex.
    fn zeros<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<Complex64>> {
        each!(&self.0, tf => tf.zeros().to_vec()).into_pyarray(py)
    }

    /// The poles: complex.
    fn poles<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<Complex64>> {
        each!(&self.0, tf => tf.poles().to_vec()).into_pyarray(py)
    }

    /// The ratio of the leading coefficients.
    #[getter]
    fn gain(&self) -> f64 {
        each!(&self.0, tf => tf.gain())
    }

    /// Numerator coefficients, highest power first.
    #[getter]
    fn num<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, each!(&self.0, tf => tf.numerator()))
    }

    /// Denominator coefficients, highest power first, the first one 1.
    #[getter]
    fn den<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        array1(py, each!(&self.0, tf => tf.denominator()))
    }

    /// The delay, s.
    #[getter]
    fn delay(&self) -> f64 {
        each!(&self.0, tf => tf.domain().delay_s(tf.delay()))
    }

    /// The sample time, s; None for continuous time.
    #[getter]
    fn sample_time(&self) -> Option<f64> {
        match &self.0 {
            Either::Continuous(_) => None,
            Either::Sampled(tf) => Some(tf.domain().0.seconds()),
        }
    }

    /// Poles minus zeros.
    #[getter]
    fn relative_degree(&self) -> usize {
        each!(&self.0, tf => tf.relative_degree())
    }

    /// Every pole decays.
    #[getter]
    fn is_stable(&self) -> bool {
        each!(&self.0, tf => tf.poles().iter().all(|&p| tf.domain().is_stable_pole(p)))
    }

    /// The frequency response, delay included, at `omega` (rad/s): complex, of the same shape, (K,) or one number.
    fn frequency_response<'py>(
        &self,
        py: Python<'py>,
        omega: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArrayDyn<Complex64>>> {
        let (omegas, single) = frequencies(omega)?;
        let values: Vec<Complex64> = omegas
            .iter()
            .map(|&omega| each!(&self.0, tf => tf.frequency_response(omega)))
            .collect();
        let shape = if single { vec![] } else { vec![omegas.len()] };
        values.into_pyarray(py).reshape(shape)
    }

    /// The same function with every zero and pole closer than `tolerance` (relative to their size, at least 1) taken off in pairs.
    #[pyo3(signature = (tolerance = 1e-9))]
    fn cancelled(&self, tolerance: f64) -> Self {
        Self(map!(&self.0, tf => tf.cancelled(tolerance)))
    }

    /// A state-space model of it: a cascade of sections of first and second order.
    fn to_state_space(&self, py: Python<'_>) -> PyResult<StateSpace> {
        Ok(StateSpace(map!(&self.0, tf => tf.to_state_space().or_raise(py)?)))
    }

    fn __eq__(&self, other: &Self) -> bool {
        self.0 == other.0
    }

    fn __repr__(&self) -> String {
        let (num, den) = each!(&self.0, tf => (tf.numerator(), tf.denominator()));
        let mut text = format!(
            "<TransferFunction: {}, num {}, den {}",
            time(self.sample_time()),
            list(num.iter()),
            list(den.iter())
        );
        if self.delay() > 0.0 {
            text += &format!(", delay {} s", short(self.delay()));
        }
        text + ">"
    }

    /// The fraction, for notebooks.
    fn _repr_latex_(&self) -> String {
        let (num, den) = each!(&self.0, tf => (tf.numerator(), tf.denominator()));
        let (variable, delay, after) = match &self.0 {
            Either::Continuous(tf) => (
                "s",
                (tf.delay() > 0.0).then(|| format!(r"\,e^{{-{} s}}", short(tf.delay()))),
                String::new(),
            ),
            Either::Sampled(tf) => (
                "z",
                (tf.delay() > 0).then(|| format!(r"\,z^{{-{}}}", tf.delay())),
                format!(r",\quad T_s = {}\,\mathrm{{s}}", short(tf.domain().0.seconds())),
            ),
        };
        format!(
            r"$$\frac{{{}}}{{{}}}{}{after}$$",
            polynomial(&num, variable),
            polynomial(&den, variable),
            delay.unwrap_or_default()
        )
    }

    /// Pickles by its zeros, poles and gain.
    #[allow(clippy::type_complexity)]
    fn __reduce__<'py>(
        slf: &Bound<'py, Self>,
    ) -> PyResult<(
        Bound<'py, PyAny>,
        (Bound<'py, PyArray1<Complex64>>, Bound<'py, PyArray1<Complex64>>, f64, Option<f64>, f64),
    )> {
        let (py, tf) = (slf.py(), slf.get());
        let make = py.import("deadtime._native")?.getattr("_transfer_function")?;
        Ok((make, (tf.zeros(py), tf.poles(py), tf.gain(), tf.sample_time(), tf.delay())))
    }
}

/// A transfer function from zeros, poles and gain, for pickle.
#[pyfunction]
pub(super) fn _transfer_function(
    py: Python<'_>,
    zeros: &Bound<'_, PyAny>,
    poles: &Bound<'_, PyAny>,
    gain: f64,
    sample_time: Option<f64>,
    delay: f64,
) -> PyResult<TransferFunction> {
    TransferFunction::from_zeros_poles_gain(py, zeros, poles, gain, sample_time, delay)
}

/// A function of `deadtime.models`, which handles the types of other packages.
fn models<'py>(py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    py.import("deadtime.models")?.getattr(name)
}

/// Models of at most so many states and inputs or outputs show their matrices.
const SMALL: usize = 7;

/// Rows and columns; a number is one of each.
pub(super) fn table(name: &str, value: &Bound<'_, PyAny>) -> PyResult<DMatrix<f64>> {
    let array = value.py().import("numpy")?.call_method1("asarray", (value,))?;
    let dimensions: usize = array.getattr("ndim")?.extract()?;
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    if !"biuf".contains(&kind) {
        return Err(PyTypeError::new_err(format!(
            "{name} holds {}; it must hold real numbers",
            array.getattr("dtype")?
        )));
    }
    match dimensions {
        0 => Ok(DMatrix::from_element(1, 1, array.extract()?)),
        2 => Ok(matrix(&array.extract::<Table<'_>>()?)),
        _ => Err(PyValueError::new_err(format!(
            "{name} has {dimensions} dimension{}; a matrix has two, rows and columns, as in [[1, 2]] for one row",
            if dimensions == 1 { "" } else { "s" }
        ))),
    }
}

/// A list of real numbers.
pub(super) fn numbers(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    let array = value.py().import("numpy")?.call_method1("asarray", (value,))?;
    let (dimensions, kind): (usize, String) =
        (array.getattr("ndim")?.extract()?, array.getattr("dtype")?.getattr("kind")?.extract()?);
    if !"biuf".contains(&kind) || dimensions > 1 {
        return Err(PyTypeError::new_err(format!("{name} must be a list of real numbers")));
    }
    if dimensions == 0 { Ok(vec![array.extract()?]) } else { Ok(vector(&array.extract()?)) }
}

/// A list of complex numbers.
fn roots(name: &str, value: &Bound<'_, PyAny>) -> PyResult<Vec<Complex<f64>>> {
    let array = value.py().import("numpy")?.call_method1("ravel", (value,))?;
    let array = array
        .call_method1("astype", ("complex128",))
        .map_err(|_| PyTypeError::new_err(format!("{name} must be a list of numbers")))?;
    Ok(array.cast::<PyArray1<Complex64>>()?.readonly().as_array().iter().copied().collect())
}

/// Angular frequencies, and whether it was one number.
fn frequencies(omega: &Bound<'_, PyAny>) -> PyResult<(Vec<f64>, bool)> {
    let single =
        omega.py().import("numpy")?.call_method1("ndim", (omega,))?.extract::<usize>()? == 0;
    Ok((numbers("omega", omega)?, single))
}

/// A delay in the unit of its domain, and the domain.
fn domain(
    py: Python<'_>,
    sample_time: Option<f64>,
    delay_s: f64,
) -> PyResult<Either<(f64, Continuous), (usize, Sampled)>> {
    let Some(seconds) = sample_time else { return Ok(Either::Continuous((delay_s, Continuous))) };
    let ts = SampleTime::new(seconds).or_raise(py)?;
    Ok(Either::Sampled((samples(py, ts, delay_s)?, Sampled(ts))))
}

/// Whole samples of a delay in seconds.
fn samples(py: Python<'_>, sample_time: SampleTime, delay_s: f64) -> PyResult<usize> {
    let delay = sample_time.samples(delay_s).map_err(|e: TimeError| raise(py, e))?;
    if delay.fraction == 0.0 {
        Ok(delay.whole)
    } else {
        Err(raise(
            py,
            ModelError::Number {
                path: "model".into(),
                key: "input_delay",
                value: delay_s,
                rule: "a sampled model's delays are multiples of its sample time; convert the continuous model instead",
            },
        ))
    }
}

fn time(sample_time: Option<f64>) -> String {
    sample_time
        .map_or_else(|| "continuous".to_owned(), |ts| format!("sampled every {} s", short(ts)))
}

fn count(n: usize, what: &str) -> String {
    format!("{n} {what}{}", if n == 1 { "" } else { "s" })
}

/// Five significant digits, or fewer if there are no more.
fn short(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return format!("{value}");
    }
    let rounded: f64 = format!("{value:.4e}").parse().unwrap_or(value);
    if (1e-4..1e6).contains(&rounded.abs()) { format!("{rounded}") } else { format!("{rounded:e}") }
}

fn list<'a>(values: impl Iterator<Item = &'a f64>) -> String {
    format!("[{}]", values.map(|v| short(*v)).collect::<Vec<_>>().join(", "))
}

fn rows(matrix: &DMatrix<f64>) -> String {
    format!("[{}]", matrix.row_iter().map(|row| list(row.iter())).collect::<Vec<_>>().join(", "))
}

fn latex(matrix: &DMatrix<f64>) -> String {
    let row = |row: nalgebra::RowDVector<f64>| {
        row.iter().map(|v| latex_number(*v)).collect::<Vec<_>>().join(" & ")
    };
    let body: Vec<String> = matrix.row_iter().map(|r| row(r.into_owned())).collect();
    format!(r"\begin{{bmatrix}} {} \end{{bmatrix}}", body.join(r" \\ "))
}

fn latex_number(value: f64) -> String {
    let text = short(value);
    match text.split_once('e') {
        Some((mantissa, exponent)) => format!(r"{mantissa}\cdot 10^{{{exponent}}}"),
        None => text,
    }
}

fn polynomial(coefficients: &[f64], variable: &str) -> String {
    let degree = coefficients.len() - 1;
    let mut text = String::new();
    for (i, &c) in coefficients.iter().enumerate().filter(|(_, c)| **c != 0.0) {
        let power = match degree - i {
            0 => String::new(),
            1 => variable.to_owned(),
            n => format!("{variable}^{{{n}}}"),
        };
        let size =
            if c.abs() == 1.0 && !power.is_empty() { String::new() } else { latex_number(c.abs()) };
        let sign = match (c < 0.0, text.is_empty()) {
            (true, true) => "-",
            (true, false) => " - ",
            (false, true) => "",
            (false, false) => " + ",
        };
        text += &format!("{sign}{size}{power}");
    }
    if text.is_empty() { "0".to_owned() } else { text }
}
