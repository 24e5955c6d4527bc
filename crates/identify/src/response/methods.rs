//! The list of estimators of frequency responses.

use super::lpm::LocalPolynomial;
use super::reference;
use super::responses::{ResponseMethod, Responses, of};
use super::welch::Welch;
use crate::error::IdentifyError;
use crate::error::Result;
use crate::subspace::recordings::Recordings;
use deadtime_log::Log;
use deadtime_signal::registry::{Entry, entry, find};
use serde_json::Value;

/// Every method.
pub const RESPONSES: &[Entry<dyn ResponseMethod>] = &[
    entry!(
        "lpm",
        "local polynomials of response and transient, with the noise: leakage goes",
        LocalPolynomial,
        dyn ResponseMethod
    ),
    entry!(
        "welch",
        "averaged spectra of windowed segments, with coherence",
        Welch,
        dyn ResponseMethod
    ),
];

/// Frequency responses from the named inputs to the named outputs by the method of this name.
///
/// Inputs: logs on one even grid, any number of records. `references`: external signals of a closed loop, as many as inputs. Then G = G_yr·G_ur⁻¹, which
/// feedback of noise does not bias. Source: Pintelon and Schoukens (2012), "System Identification: A Frequency Domain Approach", 2nd ed., section 2.6 and
/// chapter 7, doi:10.1002/9781118287422.
///
/// # Errors
/// [`deadtime_log::LogError`] for channels and time stamps, [`deadtime_signal::registry::RegistryError`] for method and options, [`IdentifyError`] for
/// the data.
pub fn frequency_responses(
    logs: &[Log],
    (inputs, outputs, references): (&[String], &[String], &[String]),
    method: &str,
    options: Value,
) -> Result<Responses> {
    let line = find(RESPONSES, "frequency response method", method)?;
    let method = line.with(options)?;
    if references.is_empty() {
        let recordings = Recordings::from_logs(logs, inputs, outputs)?;
        recordings.scales()?;
        let seen = method.lines(&recordings)?;
        return Ok(of(line.name, recordings, seen, Vec::new()));
    }
    if references.len() != inputs.len() {
        return Err(IdentifyError::References {
            references: references.len(),
            inputs: inputs.len(),
        }
        .into());
    }
    let both: Vec<String> = outputs.iter().chain(inputs).cloned().collect();
    let recordings = Recordings::from_logs(logs, references, &both)?;
    recordings.scales()?;
    let seen = reference::divided(method.lines(&recordings)?, outputs.len())?;
    let Recordings { sample_time, inputs: references, outputs: mut all, stretches } = recordings;
    let inputs = all.split_off(outputs.len());
    Ok(of(line.name, Recordings { sample_time, inputs, outputs: all, stretches }, seen, references))
}
