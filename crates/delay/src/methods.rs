//! The list of estimators.

use super::method::Method;
use super::{
    area, correlation, events, frequency, higher_order, laguerre, parametric, process, states,
    threshold,
};

/// Every estimator; within a class the most trusted first.
pub const METHODS: &[Method] = &[
    parametric::oestruc::METHOD,
    parametric::armaxstruc::METHOD,
    parametric::ivstruc::METHOD,
    parametric::arxstruc::METHOD,
    parametric::met1struc::METHOD,
    parametric::oe_posterior::METHOD,
    parametric::two_step::METHOD,
    parametric::sampling_zero::METHOD,
    parametric::delayest::METHOD,
    parametric::elnaggar::METHOD,
    process::family::P2D,
    process::family::P1D,
    process::family::P3D,
    process::family::P2DZ,
    process::family::P1DZ,
    process::family::P3DZ,
    threshold::impulse::METHOD,
    threshold::impulseest::METHOD,
    threshold::cusum::METHOD,
    threshold::step::METHOD,
    threshold::cusum_step::METHOD,
    correlation::weights::HANNAN_THOMSON,
    correlation::weights::SCOT,
    correlation::weights::CROSSCORR,
    correlation::weights::ECKART,
    correlation::weights::PHAT,
    correlation::weights::ROTH,
    frequency::oedap::METHOD,
    frequency::arxdap::METHOD,
    frequency::firdap::METHOD,
    frequency::phase_slope::METHOD,
    higher_order::bispectrum::METHOD,
    laguerre::lagudap::METHOD,
    laguerre::fischer::METHOD,
    area::area1::METHOD,
    area::estimated::AREA3,
    area::estimated::AREA2,
    area::estimated::MOMENT,
    states::state_least_squares::METHOD,
    events::criteria::AVERAGE_DIFFERENCE,
    events::criteria::CORRELATION,
    events::criteria::QUADRATIC_DIFFERENCE,
    events::criteria::VARIANCE_DIFFERENCE,
    events::criteria::DELAY_VARIANCE,
];

/// Estimators that run only where the record has the condition that they are made for.
pub const CONDITIONAL: &[Method] = &[process::integrating::P1DI, process::integrating::P0DI];

/// All of both lists.
pub(crate) fn every() -> impl Iterator<Item = &'static Method> {
    METHODS.iter().chain(CONDITIONAL)
}

/// The method called `name`.
#[must_use]
pub fn method(name: &str) -> Option<&'static Method> {
    every().find(|m| m.entry.name == name)
}
