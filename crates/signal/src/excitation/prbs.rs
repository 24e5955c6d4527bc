//! Pseudo-random binary sequence of a maximum-length shift register.
//!
//! bit(k) = sum over the taps t of bit(k − t), modulo 2: period 2ⁿ − 1 bits, each held for `clock` samples.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::check;
use super::generator::Excitation;
use crate::error::{Allowed, SignalError};

/// Least order of the register.
const LEAST: usize = 2;
/// Taps of a primitive polynomial for each order from [`LEAST`] on; the orders' tests find the full period of each.
const TAPS: [&[u32]; 17] = [
    &[2, 1],
    &[3, 2],
    &[4, 3],
    &[5, 3],
    &[6, 5],
    &[7, 6],
    &[8, 6, 5, 4],
    &[9, 5],
    &[10, 7],
    &[11, 9],
    &[12, 6, 4, 1],
    &[13, 4, 3, 1],
    &[14, 5, 3, 1],
    &[15, 14],
    &[16, 15, 13, 4],
    &[17, 14],
    &[18, 11],
];
/// Greatest order of the register.
const MOST: usize = LEAST + TAPS.len() - 1;

/// Where in its period a sequence begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum RegisterStart {
    /// All bits of the register set: the same sequence every time.
    #[default]
    Ones,
    /// A random state: the same sequence, begun at a random point.
    Random,
}

/// A PRBS: binary, exactly periodic, with the autocorrelation of white noise. With levels ±1 it is 1 at multiples of the period and −1/(2ⁿ − 1) elsewhere (at a
/// clock of one sample).
///
/// The record is cut where the samples end; only whole periods of (2ⁿ − 1)·`clock` samples have the autocorrelation above.
///
/// Source: S. W. Golomb, 1967, "Shift Register Sequences"; MATLAB System Identification Toolbox, documentation of `idinput` ('prbs').
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Prbs {
    /// Order n of the register, 2 to 18; default 0: the largest whose whole period fits into the requested samples (2 when none does).
    pub order: usize,
    /// Samples for which each bit is held, at least 1; default 1.
    pub clock: usize,
    /// The two values, in the input's unit, the lower first; default [−1, 1].
    pub levels: [f64; 2],
    /// Where in its period the sequence begins; default all ones.
    pub start: RegisterStart,
}

impl Default for Prbs {
    fn default() -> Self {
        Self { order: 0, clock: 1, levels: [-1.0, 1.0], start: RegisterStart::Ones }
    }
}

impl Excitation for Prbs {
    fn generate(&self, samples: usize, rng: &mut ChaCha8Rng) -> Result<Vec<f64>, SignalError> {
        let Self { order, clock, levels: [low, high], start } = *self;
        check::samples(samples)?;
        let known = order == 0 || (LEAST..=MOST).contains(&order);
        check::allowed(
            "prbs",
            "order",
            order as f64,
            known,
            Allowed::ZeroOrBetween(LEAST as f64, MOST as f64),
        )?;
        check::at_least("prbs", "clock", clock, 1)?;
        check::levels("prbs", [low, high])?;
        let fits = |n: &usize| clock.saturating_mul((1 << n) - 1) <= samples;
        let order =
            if order == 0 { (LEAST..=MOST).rev().find(fits).unwrap_or(LEAST) } else { order };
        let full: u32 = (1 << order) - 1;
        let mut register = match start {
            RegisterStart::Ones => full,
            RegisterStart::Random => rng.random_range(1..=full),
        };
        // Bit t − 1 of the register is the bit of t clocks ago.
        let mask = TAPS[order - LEAST].iter().fold(0_u32, |mask, tap| mask | 1 << (tap - 1));
        let mut u = Vec::with_capacity(samples);
        while u.len() < samples {
            let level = if register >> (order - 1) == 1 { high } else { low };
            u.extend(std::iter::repeat_n(level, clock.min(samples - u.len())));
            register = ((register << 1) & full) | ((register & mask).count_ones() % 2);
        }
        Ok(u)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::SeedableRng;

    fn generate(prbs: Prbs, samples: usize) -> Vec<f64> {
        prbs.generate(samples, &mut ChaCha8Rng::seed_from_u64(1)).unwrap()
    }

    #[test]
    fn period_is_exactly_two_to_the_order_less_one() {
        for order in LEAST..=MOST {
            let period = (1 << order) - 1;
            let u = generate(Prbs { order, ..Prbs::default() }, 2 * period + 5);
            assert!(u.iter().zip(&u[period..]).all(|(a, b)| a == b), "order {order}");
            // The window of `order` bits is the register: it must not come back earlier.
            let first = &u[..order];
            let again = (1..=period).find(|&k| &u[k..k + order] == first).unwrap();
            assert_eq!(again, period, "order {order}");
        }
    }

    #[test]
    fn one_period_holds_one_more_high_than_low() {
        for order in LEAST..=MOST {
            let sum: f64 =
                generate(Prbs { order, ..Prbs::default() }, (1 << order) - 1).iter().sum();
            assert_eq!(sum, 1.0, "order {order}");
        }
    }

    #[test]
    fn autocorrelation_off_the_peak_is_minus_one_over_the_period() {
        for order in LEAST..=12 {
            let u = generate(Prbs { order, ..Prbs::default() }, (1 << order) - 1);
            for lag in 1..u.len() {
                let sum: f64 =
                    u.iter().zip(u[lag..].iter().chain(&u[..lag])).map(|(a, b)| a * b).sum();
                assert_eq!(sum, -1.0, "order {order}, lag {lag}");
            }
        }
    }

    #[test]
    fn clock_holds_each_bit() {
        let fast = generate(Prbs { order: 5, ..Prbs::default() }, 31);
        let slow = generate(Prbs { order: 5, clock: 3, ..Prbs::default() }, 93);
        assert!(slow.iter().enumerate().all(|(k, &v)| v == fast[k / 3]));
    }

    #[test]
    fn automatic_order_is_the_largest_whose_period_fits() {
        for (samples, clock, order) in [
            (1, 1, 2),
            (6, 1, 2),
            (7, 1, 3),
            (1000, 1, 9),
            (1000, 10, 6),
            (1023, 1, 10),
            (300_000, 1, 18),
        ] {
            let automatic = generate(Prbs { clock, ..Prbs::default() }, samples);
            assert_eq!(
                automatic,
                generate(Prbs { clock, order, ..Prbs::default() }, samples),
                "{samples} samples at clock {clock}"
            );
        }
    }

    #[test]
    fn random_start_is_the_same_sequence_shifted() {
        let u = generate(Prbs { order: 6, ..Prbs::default() }, 126);
        let shifted =
            generate(Prbs { order: 6, start: RegisterStart::Random, ..Prbs::default() }, 63);
        assert!((0..63).any(|k| u[k..k + 63] == shifted[..]));
    }

    #[test]
    fn impossible_registers_are_refused() {
        let rng = &mut ChaCha8Rng::seed_from_u64(1);
        for order in [1, 19, usize::MAX] {
            assert!(matches!(
                Prbs { order, ..Prbs::default() }.generate(10, rng),
                Err(SignalError::Option { option: "order", .. })
            ));
        }
        assert!(Prbs { clock: 0, ..Prbs::default() }.generate(10, rng).is_err());
        assert!(Prbs { levels: [0.0, 0.0], ..Prbs::default() }.generate(10, rng).is_err());
    }
}
