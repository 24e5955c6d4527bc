//! A signal that excites a system.

use crate::error::SignalError;
use rand_chacha::ChaCha8Rng;

/// A signal that can be made at any length. The implementor is its own set of options.
pub trait Excitation: Send + Sync {
    /// The signal's first `samples` values, all finite, in the unit of its amplitude or levels. Deterministic signals leave `rng` alone.
    ///
    /// # Errors
    /// [`SignalError::NoSamples`], [`SignalError::TooManySamples`]; [`SignalError::TooFewSamples`] when a signal of fixed shape does not fit; the other
    /// variants when an option is outside its range.
    fn generate(&self, samples: usize, rng: &mut ChaCha8Rng) -> Result<Vec<f64>, SignalError>;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::excitation::excitations::{EXCITATIONS, by_name};
    use rand_chacha::rand_core::SeedableRng;
    use serde_json::{Value, json};

    fn rng(seed: u64) -> ChaCha8Rng {
        ChaCha8Rng::seed_from_u64(seed)
    }

    #[test]
    fn every_default_generates_finite_samples_or_says_how_many_it_needs() {
        for entry in EXCITATIONS {
            let signal = entry.with(json!({})).unwrap();
            for samples in [1, 2, 151, 1000] {
                match signal.generate(samples, &mut rng(1)) {
                    Ok(u) => {
                        assert_eq!(u.len(), samples, "{}", entry.name);
                        assert!(u.iter().all(|v| v.is_finite()), "{}", entry.name);
                    }
                    Err(SignalError::TooFewSamples { signal, needed, got }) => {
                        assert_eq!((signal, got), (entry.name, samples));
                        assert!(needed > samples && needed <= 151);
                    }
                    Err(other) => {
                        assert!(
                            matches!(other, SignalError::NoLines { .. }) && samples <= 2,
                            "{} at {samples}: {other}",
                            entry.name
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn every_default_varies_over_a_usual_record() {
        for entry in EXCITATIONS {
            let u = entry.with(json!({})).unwrap().generate(151, &mut rng(1)).unwrap();
            assert!(u.iter().any(|&v| v != u[0]), "{}", entry.name);
        }
    }

    #[test]
    fn same_seed_gives_the_same_signal() {
        for entry in EXCITATIONS {
            let signal = entry.with(json!({})).unwrap();
            assert_eq!(
                signal.generate(151, &mut rng(9)),
                signal.generate(151, &mut rng(9)),
                "{}",
                entry.name
            );
        }
    }

    #[test]
    fn no_samples_and_absurdly_many_are_refused() {
        for entry in EXCITATIONS {
            let signal = entry.with(json!({})).unwrap();
            assert_eq!(
                signal.generate(0, &mut rng(1)),
                Err(SignalError::NoSamples),
                "{}",
                entry.name
            );
            assert!(
                matches!(
                    signal.generate(usize::MAX, &mut rng(1)),
                    Err(SignalError::TooManySamples { .. })
                ),
                "{}",
                entry.name
            );
        }
    }

    #[test]
    fn unknown_options_are_refused_and_the_known_ones_listed() {
        for entry in EXCITATIONS {
            let Err(refused) = entry.with(json!({ "amplitud": 1.0 })) else {
                panic!("{} takes any option", entry.name)
            };
            let message = refused.to_string();
            assert!(message.contains("amplitud") && message.contains(entry.name), "{message}");
            for known in (entry.defaults)().as_object().unwrap().keys() {
                assert!(message.contains(known), "{message} does not name {known}");
            }
        }
    }

    #[test]
    fn defaults_are_the_options_of_an_empty_table() {
        for entry in EXCITATIONS {
            let (from_nothing, from_defaults) =
                (entry.with(json!({})).unwrap(), entry.with((entry.defaults)()).unwrap());
            assert_eq!(
                from_nothing.generate(200, &mut rng(2)),
                from_defaults.generate(200, &mut rng(2)),
                "{}",
                entry.name
            );
        }
    }

    #[test]
    fn numbers_far_outside_an_options_range_never_panic_or_make_nan() {
        for entry in EXCITATIONS {
            let Value::Object(defaults) = (entry.defaults)() else {
                panic!("{} has no table of options", entry.name)
            };
            for (key, default) in &defaults {
                for value in [
                    json!(-1.0),
                    json!(0),
                    json!(1e308),
                    json!(u64::MAX),
                    json!([1.0, 1.0]),
                    json!([-1e308, 1e308]),
                    json!("x"),
                ] {
                    if let Ok(signal) = entry.with(json!({ key: value }))
                        && let Ok(u) = signal.generate(151, &mut rng(1))
                    {
                        assert!(
                            u.len() == 151 && u.iter().all(|v| v.is_finite()),
                            "{} {key}={value} (default {default})",
                            entry.name
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn unknown_names_are_answered_with_the_known_ones() {
        let Err(refused) = by_name("prsb") else { panic!("found") };
        for entry in EXCITATIONS {
            assert!(refused.to_string().contains(entry.name));
        }
        assert_eq!(by_name("chirp").unwrap().name, "chirp");
    }

    #[test]
    fn names_are_unique() {
        for (i, entry) in EXCITATIONS.iter().enumerate() {
            assert!(EXCITATIONS[..i].iter().all(|other| other.name != entry.name));
        }
    }
}
