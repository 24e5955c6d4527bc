//! The names in the library's messages, as options of the command line.

use std::error::Error;

use crate::remedy::{Message, Remedied, Remedy};

/// The option of a remedy, in the typed form.
pub(super) fn option(remedy: &Remedy) -> String {
    let option = match remedy {
        Remedy::MaxDelay => "--max-delay",
        Remedy::StepTime => "--step-time",
        Remedy::Model => "--model",
        Remedy::Rename => "`--map NAME=COLUMN`",
        Remedy::ColumnOf { channel } => return format!("`--map {channel}=COLUMN`"),
        Remedy::Columns { of } => {
            let each: Vec<String> =
                of.iter().map(|(name, column)| format!("--map {name}={column}")).collect();
            return each.join(" ");
        }
        Remedy::NewNames => "`--map` makes",
        Remedy::Events => "--events A,B",
        Remedy::Channels => "--input and --output",
        Remedy::Records => "with `--records COLUMN`",
        Remedy::Window => "`--from S --to S`",
        Remedy::Resample => "`--resample TS`",
        Remedy::ResampleAt { seconds } => return format!("`--resample {seconds}`"),
        Remedy::TimeColumn => "`--time COLUMN`",
        Remedy::TimeUnit => "`--time-unit s|ms|us|ns|min|h|d|iso|dmy|mdy`",
        Remedy::ColumnNames => "`--columns NAME,NAME,…`",
        Remedy::Only { column, value } => return format!("`--where {column}={value}`"),
        Remedy::Missing { number } => return format!("--missing {number}"),
        Remedy::Unchecked => "--unchecked",
        Remedy::HeaderStamps => "--stamps header",
        Remedy::ClosedLoop => "--loop closed",
        Remedy::Delay => "--delay",
        Remedy::States => "--states \"NAME=CHANNEL,…\"",
        Remedy::Candidate { term } => return format!("--candidate '{term}'"),
        Remedy::FitParameters => "`deadtime identify --structure MODEL.toml --free all`",
        Remedy::Identify => "`deadtime identify`",
        Remedy::RestartEvery => "--restart-every",
        Remedy::LookAt => "--look-at",
        Remedy::Effects => "--effects or --max-minutes",
        Remedy::ExportOption { name } => return format!("--set {name}=VALUE"),
        Remedy::Resume => "`--resume`",
        Remedy::Update => "`--update`",
        Remedy::Cases => "--cases",
        Remedy::MaxMemory => "--max-memory-gb",
        Remedy::MaxDisk => "--max-disk-gb",
    };
    option.to_owned()
}

/// The two sides of `NAME=VALUE`, as the value of an option.
pub(super) fn pair<'a>(
    option: &str,
    text: &'a str,
    form: &str,
) -> anyhow::Result<(&'a str, &'a str)> {
    let parts = text.split_once('=');
    parts.ok_or_else(|| anyhow::anyhow!("--{option} {text}: write it as {form}"))
}

/// `INPUT=SECONDS` of one of these inputs.
pub(super) fn delay_of<'a>(text: &'a str, inputs: &[String]) -> Option<(&'a str, f64)> {
    let (name, seconds) = text.split_once('=')?;
    inputs.iter().any(|input| input == name).then_some((name, seconds.parse().ok()?))
}

/// The message of an error with the options that it is about.
pub(super) fn worded(error: &(dyn Error + 'static)) -> String {
    macro_rules! first_of {
        ($($kind:ty),+ $(,)?) => {
            None$(.or_else(|| error.downcast_ref::<$kind>().map(Remedied::message)))+
        };
    }
    let message: Option<Message> = first_of!(
        crate::Error,
        deadtime_log::Error,
        deadtime_model::Error,
        deadtime_identify::Error,
        deadtime_delay::Error,
        deadtime_gap::Error,
        deadtime_study::Error,
        crate::log::LogError,
        crate::identify::IdentifyError,
        crate::delay::DelayError,
        crate::diagnose::GapError,
        crate::export::ExportError,
        crate::study::StudyError,
        crate::blind::BlindError,
    );
    message.map_or_else(|| error.to_string(), |message| message.worded(option))
}

#[cfg(test)]
mod tests {
    use super::{option, worded};
    use crate::delay::DelayError;
    use crate::diagnose::GapError;
    use crate::log::{LogError, Place};
    use crate::remedy::{Message, Remedy};
    use crate::study::StudyError;

    #[test]
    fn a_remedy_names_the_option_that_is_typed() {
        let window = DelayError::MaxDelay { seconds: 9.0, step_s: 0.1, samples: 50 };
        assert!(worded(&window).starts_with("--max-delay 9 s: give"), "{window}");
        let uneven = LogError::UnevenTime {
            file: "a.csv".into(),
            place: Place::Row(7),
            time_s: 0.5,
            deviation_samples: 0.3,
            suggested_s: 0.125,
        };
        let text = worded(&crate::Error::from(uneven));
        assert!(text.ends_with("with `--resample TS`, for instance `--resample 0.125`"), "{text}");
        assert_eq!(Message::from(Remedy::ClosedLoop).worded(option), "--loop closed");
        let unstable = GapError::Unstable { log: "a.csv".into(), factor: 2e21 };
        assert!(
            worded(&deadtime_gap::Error::from(unstable))
                .contains("(--states \"NAME=CHANNEL,…\"), or close the loop")
        );
        let option = Remedy::MaxDisk;
        let budget = StudyError::Budget {
            plan: "p".into(),
            settings: 1.0,
            cells: 1.0,
            estimates: 1e12,
            what: "room on the disk",
            needed_gb: 45.0,
            limit_gb: 4.0,
            option,
        };
        assert!(worded(&budget).ends_with("lift the limit by --max-disk-gb 50"), "{budget}");
    }
}
