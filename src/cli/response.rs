//! `deadtime response`: frequency responses of logs without a model.

use std::path::{Path, PathBuf};

use anyhow::bail;

use super::progress::Bar;
use super::show::{Out, write};
use super::source::{Needed, Reading};
use crate::report::page;
use crate::report::response::{Report, csv};
use deadtime_identify::response::frequency_responses;
use deadtime_log::Log;
use deadtime_signal::file::{STANDARD_OUTPUT, component};
use deadtime_signal::registry;

/// Estimate frequency responses of logs without a model, with 95 % intervals and coherence; the table is what `deadtime estimate --frf` reads
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime response flight.csv --input rudder --output yaw_rate --out frf.csv
  deadtime response loop.csv --input rudder --output yaw_rate --reference yaw_rate_wanted --html frf.html
  deadtime estimate --frf frf.csv")]
pub(super) struct Response {
    /// Logs: records of one machine on one even grid
    #[arg(value_name = "LOG", required = true)]
    logs: Vec<PathBuf>,
    /// Input channel (the command); may be repeated
    #[arg(long, value_name = "U", required = true)]
    input: Vec<String>,
    /// Output channel (the response); may be repeated
    #[arg(long, value_name = "Y", required = true)]
    output: Vec<String>,
    /// Of a closed loop: what is fed into it from outside, one channel for each input; without it feedback of noise is a bias
    #[arg(long, value_name = "R")]
    reference: Vec<String>,
    /// Method; `deadtime list responses` shows them
    #[arg(long, value_name = "NAME", default_value = "lpm")]
    method: String,
    /// An option of the method, such as `segment=512`; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Write the response as a table (.csv); of several inputs or outputs one file each, `NAME_INPUT_OUTPUT.csv`
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Also write a page with gain, phase and coherence, one file that needs no network
    #[arg(long, value_name = "FILE")]
    html: Option<PathBuf>,
    #[command(flatten)]
    reading: Reading,
}

impl Response {
    /// Prints the responses; as JSON they are deadtime/response@1.
    pub(super) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let held: Vec<String> = self.input.iter().chain(&self.reference).cloned().collect();
        let needed = Needed { inputs: &held, outputs: &self.output, required: true };
        let read = self
            .logs
            .iter()
            .map(|path| self.reading.read(to, path, &needed))
            .collect::<anyhow::Result<Vec<_>>>()?;
        let logs: Vec<Log> = read.into_iter().flatten().collect();
        let options = registry::options(self.set.iter().map(String::as_str))?;
        let bar = Bar::new(to);
        let found = frequency_responses(
            &logs,
            (&self.input, &self.output, &self.reference),
            &self.method,
            options,
        )?;
        drop(bar);
        let report = Report {
            logs: self.logs.iter().map(|p| p.display().to_string()).collect(),
            responses: &found,
        };
        let mut written = Vec::new();
        for (input, output) in report.pairs() {
            let Some(out) = &self.out else { break };
            let one = self.input.len() == 1 && self.output.len() == 1;
            let names = self.input.get(input).zip(self.output.get(output)).filter(|_| !one);
            if names.is_some() && out.as_os_str() == STANDARD_OUTPUT {
                bail!("--out -: of several inputs or outputs each has a file of its own: name one");
            }
            let path = names.map_or_else(|| out.clone(), |(u, y)| beside(out, u, y));
            write(Some(&path), || csv(&found.pair(output, input)))?;
            written.push(path.display().to_string());
        }
        write(self.html.as_ref(), || page::response(&report))?;
        if to.wants_json() {
            to.json(&report.data())?;
        }
        say!(to, "{}", report.text().trim_end());
        if !written.is_empty() {
            say!(to, "written to {}", written.join(", "));
        }
        Ok(())
    }
}

/// `frf.csv` of one pair of several: `frf_INPUT_OUTPUT.csv`.
fn beside(out: &Path, input: &str, output: &str) -> PathBuf {
    let part = |p: Option<&std::ffi::OsStr>| p.map(|p| p.to_string_lossy().into_owned());
    let stem = part(out.file_stem()).unwrap_or_else(|| "response".to_owned());
    let end = part(out.extension()).map_or_else(String::new, |e| format!(".{e}"));
    out.with_file_name(format!("{}{end}", component(&format!("{stem}_{input}_{output}"))))
}
