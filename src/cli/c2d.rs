//! `deadtime c2d`: a sampled model from a continuous one.

use std::path::PathBuf;

use anyhow::{Context, bail};

use super::show::Out;
use deadtime_model::c2d::{CONVERSIONS, Conversion};
use deadtime_model::{Channel, ModelFile};
use deadtime_signal::registry::{find, options};
use deadtime_signal::text::printed;
use deadtime_signal::time::SampleTime;

/// Convert a continuous model to a sampled one
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime c2d model.toml --sample-time 0.02
  deadtime c2d model.toml --sample-time 0.02 --method tustin --set prewarp_rad_s=3 --out sampled.toml")]
pub(super) struct C2d {
    /// The model, deadtime/model@1
    model: PathBuf,
    /// Sample time, seconds
    #[arg(long, value_name = "S")]
    sample_time: f64,
    /// Conversion; `deadtime list conversions` shows them
    #[arg(long, value_name = "NAME", default_value = "zoh")]
    method: String,
    /// An option of the conversion, such as `feedthrough=drop` or `prewarp_rad_s=3`; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Take this input only
    #[arg(long, value_name = "U")]
    input: Option<String>,
    /// Take this output only
    #[arg(long, value_name = "Y")]
    output: Option<String>,
    /// File to write (.toml or .json); without it the model goes to standard output
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
}

impl C2d {
    /// Writes the sampled model; as JSON it is deadtime/model@1.
    pub(super) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let file = ModelFile::read(&self.model)?;
        if !file.effects.is_empty() {
            bail!(
                "{}: c2d converts the bare model; take the [[effects]] out of the file (a delay of an input can stand in input_delay_s)",
                self.model.display()
            );
        }
        let conversion = find(CONVERSIONS, "conversion", &self.method)?
            .with(options(self.set.iter().map(String::as_str))?)?;
        let about = || self.model.display().to_string();
        let pair = match (&self.input, &self.output) {
            (None, None) => None,
            (input, output) => {
                let input = position("input", &file.inputs, input.as_deref())?;
                Some((position("output", &file.outputs, output.as_deref())?, input))
            }
        };
        let result =
            file.c2d(&*conversion, SampleTime::new(self.sample_time)?, pair).with_context(about)?;
        if to.tells_progress() {
            for note in self.rounded(&file, &*conversion, pair)? {
                eprintln!("{}: {}", about(), printed(&note));
            }
        }
        to.json(&result)?;
        match &self.out {
            Some(path) => {
                result.write(path)?;
                say!(
                    to,
                    "{}: {} by {} every {} s, {} states, {}; written to {}",
                    about(),
                    file.name,
                    self.method,
                    self.sample_time,
                    result.states.len(),
                    if result.sampled()?.is_stable() { "stable" } else { "not stable" },
                    path.display()
                );
                Ok(())
            }
            None => to.document(result.to_toml()?.as_bytes()),
        }
    }
}

impl C2d {
    /// A line for each input whose delay the conversion rounds.
    fn rounded(
        &self,
        file: &ModelFile,
        conversion: &dyn Conversion,
        pair: Option<(usize, usize)>,
    ) -> anyhow::Result<Vec<String>> {
        let sample_time = SampleTime::new(self.sample_time)?;
        let sys = file.continuous()?;
        let mut notes = Vec::new();
        for (at, (input, &delay_s)) in file.inputs.iter().zip(sys.input_delay()).enumerate() {
            let delay = sample_time.samples(delay_s)?;
            let Some(whole) = conversion.rounds(delay) else { continue };
            if pair.is_some_and(|(_, input)| input != at) {
                continue;
            }
            // An all-pass filter delays by half a sample at least.
            let filter = if whole > 0 && matches!(self.method.as_str(), "tustin" | "matched") {
                "--set fractional_delay_order=1 (or more) keeps the fraction by an all-pass filter, "
            } else {
                ""
            };
            notes.push(format!(
                "{} rounds the delay of `{}`, {delay_s} s or {:.4} samples, to {whole} samples, {} s; {filter}--method zoh keeps it exactly",
                self.method,
                input.name,
                delay.total(),
                sample_time.to_seconds(whole as f64),
            ));
        }
        Ok(notes)
    }
}

/// The requested channel; without a name, the only one.
fn position(what: &str, channels: &[Channel], name: Option<&str>) -> anyhow::Result<usize> {
    let names = || channels.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", ");
    match name {
        Some(name) => match channels.iter().position(|c| c.name == name) {
            Some(at) => Ok(at),
            None => bail!("the model has no {what} `{name}`; it has {}", names()),
        },
        None if channels.len() == 1 => Ok(0),
        None => bail!("name the {what} too (--{what}): the model has {}", names()),
    }
}
