//! The error of each method in a study, and the leading methods.
//!
//! A method leads where eᵢ ≤ min e/ρ, with e the root-mean-square errors and ρ the correlation of two methods' errors. Beyond that ratio the best combination
//! of the two gives the worse one no weight.
//!
//! The errors of records under feedback are those of closed loops: methods without immunity to feedback use the open-loop part of the input there, which is
//! often small and smooth.
//!
//! How it can be wrong: the drawn plants, inputs and controllers are not those of the record.
//!
//! Source: Bates and Granger (1969), Operational Research Quarterly 20(4), 451-468, doi:10.2307/3008764, for the combination of two forecasts and the sign of its weights.

/// Open loops: root-mean-square errors relative to `oe_posterior` on the same records, where the method's estimate is used.
///
/// The records are 70 of each of the kinds `ordinary` and `benchmark` of lab/src/bin/verdict_study.rs, seeds from 100 000. Each method gets five more records
/// with 1.5 times the error, so that a small number of records does not make a method the best.
const OPEN: Study = Study {
    errors: &[
        ("p3d", 1.02),
        ("oe_posterior", 1.04),
        ("two_step", 1.07),
        ("ivstruc", 1.10),
        ("oestruc", 1.14),
        ("p2d", 1.14),
        ("armaxstruc", 1.24),
        ("arxdap", 1.36),
        ("p3dz", 1.41),
        ("impulseest", 1.42),
        ("gcc_roth", 1.49),
        ("gcc_scot", 1.49),
        ("area1", 1.50),
        ("crosscorr", 1.50),
        ("gcc_eckart", 1.50),
        ("gcc_hannan_thomson", 1.50),
        ("gcc_phat", 1.50),
        ("p1d", 1.50),
        ("phase_slope", 1.50),
        ("sampling_zero", 1.50),
        ("area2", 1.52),
        ("p2dz", 1.57),
        ("fischer", 1.60),
        ("firdap", 1.66),
        ("lagudap", 1.78),
        ("p1dz", 1.80),
        ("met1struc", 1.87),
        ("oedap", 1.93),
        ("cusum_step", 2.25),
        ("arxstruc", 2.29),
        ("threshold", 2.49),
        ("delayest", 2.63),
        ("area3", 2.68),
        ("cusum", 3.62),
        ("threshold_step", 5.08),
        ("elnaggar", 5.70),
    ],
    correlation: 0.69,
};
/// The same of closed loops: 70 of each of the kinds `loop` and `regulated`, same seeds.
const CLOSED: Study = Study {
    errors: &[
        ("armaxstruc", 0.37),
        ("met1struc", 0.39),
        ("arxdap", 0.42),
        ("arxstruc", 0.52),
        ("ivstruc", 0.56),
        ("delayest", 0.75),
        ("p2d", 0.84),
        ("oe_posterior", 1.02),
        ("p2dz", 1.05),
        ("lagudap", 1.08),
        ("oedap", 1.12),
        ("p3d", 1.20),
        ("p3dz", 1.20),
        ("fischer", 1.34),
        ("cusum", 1.35),
        ("oestruc", 1.40),
        ("two_step", 1.55),
        ("threshold", 3.49),
        ("firdap", 4.38),
        ("threshold_step", 5.22),
        ("elnaggar", 5.99),
        ("impulseest", 6.71),
        ("cusum_step", 7.14),
        ("area3", 7.50),
    ],
    correlation: 0.23,
};
/// The error of methods without an estimate there, and of those for other records.
const ELSE: f64 = 3.5;

/// A study of methods on drawn records.
pub(super) struct Study {
    errors: &'static [(&'static str, f64)],
    /// The mean correlation of the errors of two of the eight best methods on the same records.
    correlation: f64,
}

impl Study {
    /// The study of closed loops, or of open ones.
    pub(super) fn of(closed: bool) -> &'static Self {
        if closed { &CLOSED } else { &OPEN }
    }

    /// The error of a method, as a ratio to that of `oe_posterior`.
    pub(super) fn error(&self, method: &str) -> f64 {
        self.errors.iter().find(|(name, _)| *name == method).map_or(ELSE, |(_, error)| *error)
    }

    /// Whether a method leads where the best agreeing method has the error `best`.
    pub(super) fn leads(&self, method: &str, best: f64) -> bool {
        self.error(method) * self.correlation <= best
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::method::Scope;
    use crate::methods::METHODS;

    #[test]
    fn every_error_of_the_study_is_that_of_a_method() {
        for (name, error) in OPEN.errors.iter().chain(CLOSED.errors) {
            let known = METHODS.iter().find(|m| m.entry.name == *name);
            assert!(known.is_some_and(|m| m.scope == Scope::Pair) && *error > 0.0, "{name}");
        }
        assert_eq!(OPEN.error("oestruc"), 1.14);
        assert_eq!(CLOSED.error("moment"), ELSE);
        let best = OPEN.error("p3d");
        assert!(OPEN.leads("armaxstruc", best) && !OPEN.leads("met1struc", best));
    }
}
