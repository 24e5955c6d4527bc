//! The list of simulators that a diagnosis is exported to.

use super::domain_randomisation::DomainRandomisation;
use super::isaaclab::IsaacLab;
use super::mujoco::MuJoCo;
use super::node::Node;
use super::ranges::Ranges;
use super::source::Source;
use super::target::Target;
use super::transfer_function::Transfer;
use crate::error::Result;
use deadtime_signal::registry::{Entry, entry, find};

/// The targets there are.
pub static TARGETS: [Entry<dyn Target>; 4] = [
    entry!(
        "domain-randomisation",
        "a range for every parameter that was found, for any trainer: deadtime/ranges@1",
        DomainRandomisation,
        dyn Target
    ),
    entry!(
        "mujoco",
        "fields of mjModel with their ranges, by the names of actuators, joints and sensors",
        MuJoCo,
        dyn Target
    ),
    entry!(
        "isaaclab",
        "arguments of Isaac Lab's actuators, events and noise models, delays in physics steps",
        IsaacLab,
        dyn Target
    ),
    entry!(
        "transfer-function",
        "transfer functions with delay, for Simulink and python-control",
        Transfer,
        dyn Target
    ),
];

/// A diagnosis for the target called `to`, with its options as an object.
///
/// # Errors
/// [`deadtime_signal::registry::RegistryError`] for an unknown target or option, [`ExportError`](super::source::ExportError) for what cannot be handed over.
pub fn export(source: &Source<'_>, to: &str, options: serde_json::Value) -> Result<Node> {
    let target = find(&TARGETS, "target", to)?.with(options)?;
    target.export(&Ranges::new(source)?, source)
}
