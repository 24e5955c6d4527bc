//! Names of methods in other tools, and their counterparts here.

use anyhow::bail;

/// The counterpart of another tool's name of an identification method: a method of `deadtime identify`, or the command with the answer.
const IDENTIFICATION: [(&str, Meaning); 15] = [
    ("arx", Meaning::Method("pbsidopt", "a high-order ARX model reduced to states")),
    ("armax", Meaning::Method("pbsidopt", "an innovations model, which holds ARMAX")),
    ("oe", Meaning::Method("riv", "output-error models by refined instrumental variables")),
    ("bj", Meaning::Method("riv", "Box-Jenkins models with an autoregressive noise")),
    ("iv4", Meaning::Method("riv", "refined instrumental variables")),
    ("ssest", Meaning::Method("pbsidopt", "state-space models")),
    (
        "procest",
        Meaning::Command(
            "--method p1d, p2d, p1dz, p2dz, p0di or p1di, or leave out --method to compare them",
        ),
    ),
    (
        "delayest",
        Meaning::Command("`deadtime estimate LOG --input U --output Y --method delayest`"),
    ),
    (
        "impulseest",
        Meaning::Command(
            "`deadtime estimate LOG --input U --output Y --html PAGE`, which shows the impulse response",
        ),
    ),
    (
        "finddelay",
        Meaning::Command("`deadtime estimate LOG --input U --output Y --method crosscorr`"),
    ),
    ("spa", Meaning::Command("`deadtime response LOG --input U --output Y`")),
    ("etfe", Meaning::Command("`deadtime response LOG --input U --output Y`")),
    ("greyest", Meaning::Command("`deadtime identify LOG --structure MODEL.toml --free all`")),
    (
        "pem",
        Meaning::Command(
            "`deadtime identify LOG --structure MODEL.toml --free all` of a given structure, or --method pbsidopt",
        ),
    ),
    ("auto", Meaning::Command("leave out --method: all are compared")),
];

/// The counterpart of another tool's name of a delay estimator.
const ESTIMATORS: [(&str, &str); 14] = [
    ("arx", "arxstruc"),
    ("armax", "armaxstruc"),
    ("oe", "oestruc"),
    ("iv", "ivstruc"),
    ("iv4", "ivstruc"),
    ("xcorr", "crosscorr"),
    ("finddelay", "crosscorr"),
    ("gccphat", "gcc_phat"),
    ("phat", "gcc_phat"),
    ("procest", "p2d"),
    ("spa", "phase_slope"),
    ("impulse", "impulseest"),
    ("laguerre", "lagudap"),
    ("states", "state_least_squares"),
];

/// The meaning of a name.
#[derive(Debug, Clone, Copy)]
enum Meaning {
    /// A method here, and its summary.
    Method(&'static str, &'static str),
    /// The command to type instead.
    Command(&'static str),
}

/// The method of `deadtime identify` that a name means: the name itself, or that of another tool's method with a sentence about it.
///
/// # Errors
/// Where another command answers: it is named.
pub(super) fn identifier(name: &str) -> anyhow::Result<(&str, Option<String>)> {
    let meaning = IDENTIFICATION.iter().find(|(other, _)| other.eq_ignore_ascii_case(name));
    match meaning.map(|(_, meaning)| *meaning) {
        None => Ok((name, None)),
        Some(Meaning::Method(method, what)) => {
            Ok((method, Some(format!("--method {name}: {method} is used, {what}"))))
        }
        Some(Meaning::Command(instead)) => bail!("--method {name}: use {instead}"),
    }
}

/// The estimator that a name means, where another tool uses that name.
pub(super) fn estimator(name: &str) -> Option<&'static str> {
    ESTIMATORS.iter().find(|(other, _)| other.eq_ignore_ascii_case(name)).map(|(_, here)| *here)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_other_names_mean_is_known_here_and_is_no_name_of_ours() {
        for (other, meaning) in IDENTIFICATION {
            assert!(deadtime_delay::identifier(other).is_err(), "{other}");
            match meaning {
                Meaning::Method(method, _) => {
                    assert!(deadtime_delay::identifier(method).is_ok(), "{method}");
                    assert_eq!(identifier(other).unwrap().0, method);
                }
                Meaning::Command(_) => assert!(identifier(other).is_err()),
            }
        }
        let known = |name: &str| deadtime_delay::METHODS.iter().any(|m| m.entry.name == name);
        for (other, here) in ESTIMATORS {
            assert!(known(here) && !known(other), "{other} {here}");
        }
        assert_eq!(identifier("n4sid").unwrap(), ("n4sid", None));
    }
}
