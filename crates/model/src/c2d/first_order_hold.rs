//! First-order hold: exact where the input is a straight line between samples.

use super::conversion::{Conversion, Converted};
use super::hold::Hold;
use super::zero_order_hold;
use crate::state_space::{Continuous, StateSpace};
use deadtime_signal::time::SampleTime;

/// The triangle hold: the input is linear from u(k) to u(k+1). The state is z = x − Γ₊u, which makes the model causal.
///
/// Source: Franklin, Powell and Workman (1998), "Digital Control of Dynamic Systems", 3rd ed., section 6.3.2.
#[derive(Debug, Clone, Copy, Default, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FirstOrderHold {}

impl Conversion for FirstOrderHold {
    fn c2d(&self, sys: &StateSpace<Continuous>, sample_time: SampleTime) -> Converted {
        zero_order_hold::exact(sys, sample_time, Hold::Linear)
    }
}
