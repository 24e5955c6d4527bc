//! Dead-time estimation: the estimator trait and the list of all estimators.

mod ahead;
mod area;
mod behind_delays;
pub mod bound;
mod colour;
mod compared;
mod conditions;
mod correlation;
mod error;
mod estimate;
mod estimator;
mod events;
mod evidence;
mod excitation;
mod experiment;
mod feedback;
mod finding;
mod frequency;
mod higher_order;
mod identifiers;
mod inverse;
mod job;
mod laguerre;
mod method;
mod methods;
mod parametric;
mod posterior;
mod process;
pub mod report;
mod response;
mod richness;
mod states;

mod threshold;
pub mod track;
mod verdict;
mod watched;
mod window;

pub use crate::area::area1::Area1;
pub use crate::area::estimated::{Area2, Area3, Moment};
pub use crate::correlation::weights::{
    Crosscorr, GccEckart, GccHannanThomson, GccPhat, GccRoth, GccScot,
};
pub use crate::events::criteria::{
    EventAverageDifference, EventCorrelation, EventDelayVariance, EventQuadraticDifference,
    EventVarianceDifference,
};
pub use crate::events::jitter::{DelayQuantile, Jitter};
pub use crate::events::offsets::Units;
pub use crate::events::times::Events;
pub use crate::frequency::arxdap::Arxdap;
pub use crate::frequency::firdap::Firdap;
pub use crate::frequency::oedap::Oedap;
pub use crate::frequency::phase_slope::PhaseSlope;
pub use crate::higher_order::bispectrum::Bispectrum;
pub use crate::job::asked::{Feedback, Job};
pub use crate::job::chosen::{Ready, STEP_METHODS, chosen};
pub use crate::job::estimation::Expected;
pub use crate::job::events::EventsJob;
pub use crate::laguerre::fischer::Fischer;
pub use crate::laguerre::lagudap::Lagudap;
pub use crate::parametric::armaxstruc::Armaxstruc;
pub use crate::parametric::arxstruc::{Arxstruc, Others};
pub use crate::parametric::delayest::Delayest;
pub use crate::parametric::elnaggar::{Cost, Elnaggar};
pub use crate::parametric::ivstruc::Ivstruc;
pub use crate::parametric::met1struc::Met1struc;
pub use crate::parametric::oe_posterior::{Center, OePosterior};
pub use crate::parametric::oestruc::Oestruc;
pub use crate::parametric::sampling_zero::SamplingZero;
pub use crate::parametric::scans::Scans;
pub use crate::parametric::two_step::TwoStep;
pub use crate::process::family::{P1d, P1dz, P2d, P2dz, P3d, P3dz, Poles, Process};
pub use crate::process::identified::{Beginning, ProcessFit, ProcessOptions};
pub use crate::process::integrating::{Integrating, P0di, P1di};
pub use crate::process::model::{ProcessModel, Slopes};
pub use crate::response::bode::BodePhase;
pub use crate::response::estimator::{ResponseEstimator, ResponseMethod, ResponseSearch};
pub use crate::response::job::ResponseJob;
pub use crate::response::methods::RESPONSE_METHODS;
pub use crate::response::rational::Rational;
pub use crate::states::state_least_squares::{Coefficients, Selection, StateLeastSquares};
pub use crate::threshold::cusum::Cusum;
pub use crate::threshold::cusum_step::CusumStep;
pub use crate::threshold::impulse::Threshold;
pub use crate::threshold::impulseest::Impulseest;
pub use crate::threshold::response::{Prewindow, Records};
pub use crate::threshold::step::Step;
pub use crate::verdict::answer::{Said, distrust};
pub use crate::verdict::conclusion::{Grounds, RecordFacts, Verdict};
pub use crate::verdict::weighing::verdict;
pub use behind_delays::{BehindDelays, TakenOut, identify_behind_delays};
pub use compared::{Candidate as ModelCandidate, Comparison, compare_models};
pub use conditions::{conditions, moving_together, standing_off};
pub use deadtime_identify::{Initial, Record};
pub use error::{DelayError, Error, LengthRemedy, Result};
pub use estimate::{DelayEstimate, Misfit, Outcome};
pub use estimator::{DelayEstimator, Search};
pub use evidence::{Correlated, Evidence, Phase, Scan, evidence, impulse_response};
pub use experiment::{Detrend, Experiment, PlantModel, Recording, Series};
pub use feedback::{InLoop, held_for, in_loop, lead, open_part};
pub use finding::Finding;
pub use identifiers::{IDENTIFIERS, identifier};
pub use method::{
    Basis, Class, Condition, Information, Law, Method, ReferenceExperiment, Scope, Start,
};
pub use methods::{CONDITIONAL, METHODS, method};
pub use richness::{Richness, richness};
