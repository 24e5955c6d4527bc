//! The next experiment: what would separate explanations that this data cannot.

use super::trust::Hang;
use crate::effect::{Applied, Site};

/// The excitation that would separate a class, by the sites and kinds of its members.
pub(super) fn experiment(class: &[Applied]) -> String {
    let sites = |site: Site| class.iter().any(|c| c.effect.site() == site);
    let names = class.iter().map(|c| c.key()).collect::<Vec<_>>().join(", ");
    let is = |list: &[&str]| class.iter().filter(|c| list.contains(&c.effect.name())).count() > 1;
    let advice =
        if is(&["deadband", "saturation", "input_gain", "input_curve", "backlash", "quadratic_drag", "coulomb_friction", "sensor_gain"]) {
            "repeat the experiment at two or more amplitudes, with slow reversals through zero"
        } else if is(&["input_offset", "sensor_bias", "constant_disturbance", "sensor_drift", "gain_fade"]) {
            "step the operating point, and start from a known state"
        } else if is(&["input_delay", "actuator_lag", "rate_limit", "dropped_commands", "unmodelled_mode", "output_delay", "sensor_lag"])
            && !sites(Site::Output)
        {
            "excite with a broadband signal that reaches well above one over the lag, at two amplitudes"
        } else if sites(Site::Output) || sites(Site::Clock) {
            "record motion that is not caused by the commands (a release from a displaced start, a push by hand), beside the same commands"
        } else {
            "excite with a multisine over the whole bandwidth, at two amplitudes and two operating points"
        };
    format!("To separate {names}: {advice}.")
}

/// What would tell a start that is off from an effect.
pub(super) fn of_starts(hangs: &[Hang]) -> String {
    let states = hangs.iter().map(|h| format!("`{}`", h.state)).collect::<Vec<_>>().join(", ");
    format!(
        "The verdict hangs on how far the start of {states} is trusted: begin from a known state (and say so with initial_std), or step the operating point."
    )
}
