//! Thresholds on an estimated impulse or step response.

pub(super) mod cusum;
pub(super) mod cusum_step;
pub(super) mod impulse;
pub(super) mod impulseest;
mod response;
pub(super) mod step;

pub use cusum::Cusum;
pub use cusum_step::CusumStep;
pub use impulse::Threshold;
pub use impulseest::Impulseest;
pub use response::{Prewindow, Records};
pub use step::Step;
