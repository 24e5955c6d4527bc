//! A delay as an all-pass filter in continuous time, by Padé's approximant.

use nalgebra::DMatrix;

use super::error::ModelError;
use super::state_space::{Continuous, StateSpace};

/// Padé's approximant of e^(−s·delay_s) with numerator and denominator of this order, as MATLAB's `pade(T, N)` and python-control's `pade(T, n)`. The
/// approximant is all-pass; its phase is −ω·delay_s up to about 2·order/delay_s rad/s, its direct path (−1)^order. Order 0 or a zero delay gives the gain 1.
///
/// The states are those of a ladder of the elements (4k − 2)/s, the continued fraction of tanh(s/2). No polynomial is formed, so any order keeps full
/// precision.
/// Source: Golub and Van Loan (2013), "Matrix Computations", 4th ed., section 9.3.1 (the approximant); Wall (1948), "Analytic Theory of Continued Fractions",
/// section 91 (tanh).
///
/// # Errors
/// [`ModelError::Number`] for a delay that is negative or not finite.
pub fn pade(delay_s: f64, order: usize) -> Result<StateSpace<Continuous>, ModelError> {
    if !(delay_s.is_finite() && delay_s >= 0.0) {
        let rule = "it must be 0 or more";
        return Err(ModelError::Number {
            path: "pade".into(),
            key: "delay_s",
            value: delay_s,
            rule,
        });
    }
    let n = if delay_s == 0.0 { 0 } else { order };
    let one = |v: f64| DMatrix::from_element(1, 1, v);
    if n == 0 {
        let none = DMatrix::zeros(0, 0);
        return StateSpace::continuous(none, DMatrix::zeros(0, 1), DMatrix::zeros(1, 0), one(1.0));
    }
    // Series elements (odd) hold a voltage, shunt elements (even) a current, behind a resistor of 1 from the input. The output is twice the ladder's voltage
    // minus the input. Each row: a voltage or current as a combination of the states, and of the input.
    let row = |entries: &dyn Fn(usize) -> f64, input: f64| {
        let mut row: Vec<f64> = (1..=n).map(entries).collect();
        row.push(input);
        row
    };
    let odd = |k: usize, from: usize| if k >= from && k % 2 == 1 { 1.0 } else { 0.0 };
    let even = |k: usize, from: usize| if k >= from && k.is_multiple_of(2) { 1.0 } else { 0.0 };
    let series_ends = n % 2 == 1;
    // The current through series element k, and the voltage behind it.
    let current = |k: usize| match series_ends {
        true => row(&|j| -odd(j, 1) - if j < k { even(j, 1) } else { 0.0 }, 1.0),
        false => row(&|j| even(j, k), 0.0),
    };
    let voltage = |k: usize| match series_ends {
        true => row(&|j| odd(j, k + 1), 0.0),
        false => row(&|j| -even(j, 1) - if j <= k { odd(j, 1) } else { 0.0 }, 1.0),
    };
    // States scaled by the roots of their elements make the matrix skew, except for one row's square.
    let root = |k: usize| ((4 * k - 2) as f64 / delay_s).sqrt();
    let (mut a, mut b, mut c) = (DMatrix::zeros(n, n), DMatrix::zeros(n, 1), DMatrix::zeros(1, n));
    for k in 1..=n {
        let row = if k % 2 == 1 { current(k) } else { voltage(k - 1) };
        for j in 1..=n {
            a[(k - 1, j - 1)] = root(k) * row[j - 1] * root(j);
        }
        b[(k - 1, 0)] = root(k) * row[n];
    }
    let first = current(1);
    for j in 1..=n {
        c[(0, j - 1)] = -2.0 * first[j - 1] * root(j);
    }
    StateSpace::continuous(a, b, c, one(1.0 - 2.0 * first[n]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The closed form: num(s) = Σ (2n−k)! n!/((2n)! k! (n−k)!) (−s)ᵏ, den(s) = num(−s).
    #[test]
    fn low_orders_have_their_textbook_response() {
        for n in 1..=6_usize {
            let sys = pade(0.7, n).unwrap();
            for omega in [0.3, 2.0, 9.0] {
                let s = nalgebra::Complex::new(0.0, omega * 0.7);
                let mut coefficient = 1.0;
                let (mut num, mut den) =
                    (nalgebra::Complex::new(1.0, 0.0), nalgebra::Complex::new(1.0, 0.0));
                let mut power = nalgebra::Complex::new(1.0, 0.0);
                for k in 1..=n {
                    coefficient *= (n + 1 - k) as f64 / ((2 * n + 1 - k) * k) as f64;
                    power *= s;
                    den += power * coefficient;
                    num += power * coefficient * if k % 2 == 1 { -1.0 } else { 1.0 };
                }
                let got = sys.frequency_response(omega)[(0, 0)];
                assert!((got - num / den).norm() < 1e-13, "{n} {omega}: {got} {}", num / den);
            }
        }
    }

    #[test]
    fn high_orders_are_all_pass_stable_and_delays() {
        for (n, delay_s) in [(20, 1e-3), (40, 1.0), (101, 30.0)] {
            let sys = pade(delay_s, n).unwrap();
            assert!(sys.is_stable(), "{n}");
            for share in [0.1, 0.3, 0.5] {
                let omega = share * n as f64 / delay_s;
                let got = sys.frequency_response(omega)[(0, 0)];
                let delay = nalgebra::Complex::from_polar(1.0, -omega * delay_s);
                assert!((got - delay).norm() < 1e-10, "{n} {share}: {got} {delay}");
            }
            // It is all-pass beyond its band, too.
            let far = sys.frequency_response(40.0 * n as f64 / delay_s)[(0, 0)];
            assert!((far.norm() - 1.0).abs() < 1e-10, "{n}: {far}");
        }
        assert!(pade(-1.0, 2).is_err());
        assert_eq!(pade(0.0, 5).unwrap().order(), 0);
    }
}
