//! `deadtime export`: a diagnosis for other simulators.

use std::path::{Path, PathBuf};

use super::show::Out;
use super::source::{Clock, Needed, Reading};
use deadtime_gap::Diagnosis;
use deadtime_gap::export::{Source, Syntax, export};
use deadtime_model::ModelDocument;
use deadtime_signal::file::write_atomic;
use deadtime_signal::registry::options;
use deadtime_signal::stats;

/// Hand a diagnosis over: ranges for domain randomisation, MuJoCo's fields, Isaac Lab's arguments, transfer functions with delay
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  deadtime export gap --to domain-randomisation --out ranges.yaml
  deadtime export gap --to isaaclab --set physics_dt=0.005 --log flight.csv
  deadtime export gap/diagnosis.json --to transfer-function --model gap/model_with_effects.toml")]
pub(super) struct Export {
    /// The folder that `deadtime gap` wrote, or its diagnosis.json
    diagnosis: PathBuf,
    /// What to make of it; `deadtime list targets` shows them
    #[arg(long, value_name = "TARGET")]
    to: String,
    /// An option of the target, such as `physics_dt=0.005`; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// The model with its effects; default: model_with_effects.toml in the diagnosis' folder
    #[arg(long, value_name = "MODEL")]
    model: Option<PathBuf>,
    /// A training log; may be repeated. With it noise is given in the outputs' units, else as a share of their standard deviation
    #[arg(long, value_name = "LOG")]
    log: Vec<PathBuf>,
    /// Column of the logs that carries a name of the model; may be repeated
    #[arg(long, value_name = "MODEL_NAME=COLUMN")]
    map: Vec<String>,
    #[command(flatten)]
    clock: Clock,
    /// Multiply the width of every interval by this: machines of one kind differ more than one machine is uncertain
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    widen: f64,
    /// How to write it; default: by the extension of --out, else JSON
    #[arg(long, value_enum, value_name = "json|yaml")]
    syntax: Option<SyntaxName>,
    /// File to write (.json or .yaml); without it the text goes to standard output
    #[arg(short, long, value_name = "FILE")]
    out: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum SyntaxName {
    Json,
    Yaml,
}

impl Export {
    pub(super) fn run(&self, to: &Out<'_>) -> anyhow::Result<()> {
        let file = if self.diagnosis.is_dir() {
            self.diagnosis.join("diagnosis.json")
        } else {
            self.diagnosis.clone()
        };
        let diagnosis = Diagnosis::read(&file)?;
        let beside = file.with_file_name("model_with_effects.toml");
        let model = self
            .model
            .as_deref()
            .or_else(|| beside.is_file().then_some(beside.as_path()))
            .map(ModelDocument::read)
            .transpose()?;
        let source = Source {
            diagnosis: &diagnosis,
            model: model.as_ref(),
            deviations: &self.deviations(to, &diagnosis)?,
            widen: self.widen,
        };
        let made = export(&source, &self.to, options(self.set.iter().map(String::as_str))?)?;
        to.json(&made)?;
        let text = match self.syntax() {
            Syntax::Json => made.to_json(),
            Syntax::Yaml => made.to_yaml(),
        };
        match &self.out {
            Some(path) => {
                write_atomic(path, |out| out.write_all(text.as_bytes()))?;
                say!(to, "{} for {}: written to {}", file.display(), self.to, path.display());
                Ok(())
            }
            None => to.document(text.as_bytes()),
        }
    }

    fn syntax(&self) -> Syntax {
        let yaml = |path: &Path| {
            path.extension()
                .is_some_and(|e| e.eq_ignore_ascii_case("yaml") || e.eq_ignore_ascii_case("yml"))
        };
        match self.syntax {
            Some(SyntaxName::Json) => Syntax::Json,
            Some(SyntaxName::Yaml) => Syntax::Yaml,
            None if self.out.as_deref().is_some_and(yaml) => Syntax::Yaml,
            None => Syntax::Json,
        }
    }

    /// Standard deviations of the outputs over the logs that were given.
    fn deviations(
        &self,
        to: &Out<'_>,
        diagnosis: &Diagnosis,
    ) -> anyhow::Result<Vec<(String, f64)>> {
        let outputs: Vec<String> = diagnosis.gap.outputs.iter().map(|o| o.name.clone()).collect();
        let mut values = vec![Vec::new(); outputs.len()];
        let reading = Reading::whole(self.map.clone(), self.clock.clone());
        for path in &self.log {
            for log in reading.read(
                to,
                path,
                &Needed { inputs: &[], outputs: &outputs, required: true },
            )? {
                for (name, values) in outputs.iter().zip(&mut values) {
                    let output = log.output(name)?;
                    values.extend((0..log.len()).filter_map(|k| output.get(k)));
                }
            }
        }
        Ok(outputs
            .into_iter()
            .zip(values)
            .filter_map(|(name, values)| Some((name, stats::deviation(&values)?)))
            .collect())
    }
}
