//! All identification methods: subspace methods, transfer functions, process models.

use crate::process::identified::ProcessFit;
use deadtime_identify::subspace::{IdentifierLine, MOESP, N4SID, PBSIDOPT};
use deadtime_identify::{Identifier, Riv, Srivc};
use deadtime_signal::registry::{RegistryError, entry};

/// A process model's line: name, summary, poles, zero, integrator.
macro_rules! process {
    ($name:literal, $summary:literal, $poles:literal, $zero:literal, $integrates:literal) => {
        IdentifierLine {
            entry: entry!($name, $summary, ProcessFit<$poles, $zero, $integrates>, dyn Identifier),
            needs: if $integrates {
                "one input and one output, open loop, an integrating plant, an input that moves both ways"
            } else {
                "one input and one output, open loop, a stable plant of its order; a step is enough"
            },
            finds_delays: true,
            open_loop: true,
        }
    };
}

/// Every method.
pub const IDENTIFIERS: &[IdentifierLine] = &[
    PBSIDOPT,
    N4SID,
    MOESP,
    IdentifierLine {
        entry: entry!(
            "riv",
            "transfer functions of given orders by refined instrumental variables, with delays",
            Riv,
            dyn Identifier
        ),
        needs: "rich inputs that do not depend on the output (no feedback), a stable plant, one output",
        finds_delays: true,
        open_loop: true,
    },
    IdentifierLine {
        entry: entry!(
            "srivc",
            "transfer functions in continuous time by refined instrumental variables, with real-valued dead times (tfest)",
            Srivc,
            dyn Identifier
        ),
        needs: "rich inputs held between samples that do not depend on the output (no feedback), a stable plant without a direct path, one output",
        finds_delays: true,
        open_loop: true,
    },
    process!("p1d", "process model K/(1 + T1·s)·e^(−τ·s)", 1, false, false),
    process!(
        "p1dz",
        "process model K(1 + Tz·s)/(1 + T1·s)·e^(−τ·s), whole samples of delay",
        1,
        true,
        false
    ),
    process!("p2d", "process model K/((1 + T1·s)(1 + T2·s))·e^(−τ·s)", 2, false, false),
    process!("p2dz", "process model K(1 + Tz·s)/((1 + T1·s)(1 + T2·s))·e^(−τ·s)", 2, true, false),
    process!("p0di", "integrating process model K/s·e^(−τ·s)", 0, false, true),
    process!("p1di", "integrating process model K/(s(1 + T1·s))·e^(−τ·s)", 1, false, true),
];

/// Names of the methods in other tools.
const ALIASES: [(&str, &str); 1] = [("tfest", "srivc")];

/// The line called `name`, in this program or in other tools.
///
/// # Errors
/// [`RegistryError::Unknown`], with the known names.
pub fn identifier(name: &str) -> Result<&'static IdentifierLine, RegistryError> {
    let own = ALIASES.iter().find(|(other, _)| *other == name).map_or(name, |(_, own)| *own);
    IDENTIFIERS.iter().find(|line| line.entry.name == own).ok_or_else(|| RegistryError::Unknown {
        kind: "identification method",
        name: name.to_owned(),
        known: IDENTIFIERS.iter().map(|line| line.entry.name).collect(),
    })
}
