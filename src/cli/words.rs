//! What the library names, as options of the command line.

use deadtime_delay::report::Report;

/// Words of the library's messages, and the option that a reader of the command line has for each.
const OPTIONS: [(&str, &str); 21] = [
    ("the new names make two columns called", "`--map` makes two columns called"),
    ("`max_delay`", "--max-delay"),
    ("`step_time`", "--step-time"),
    ("give a `model` and", "give --model and"),
    ("(`rename`)", "(--map)"),
    ("give two sequences of them", "give --events A,B"),
    ("give `model`, such as", "give --model, such as"),
    ("needs the option physics_dt", "needs --set physics_dt=SECONDS"),
    ("give the option inertia={", "give --set inertia={"),
    ("give an input and an output", "give --input and --output"),
    ("to `read_records`", "with `--records COLUMN`"),
    ("take another `window` of the log", "cut the log with `--from S --to S`"),
    ("a wider `window`", "a wider `--from S --to S`"),
    ("choose a `window`", "choose `--from S --to S`"),
    ("`resample(sample_time)`", "`--resample TS`"),
    ("give `resample` a larger", "give `--resample TS` a larger"),
    ("`rename` each column once", "give each column one `--map model_name=column`"),
    ("`resume`", "`--resume`"),
    ("`update`", "`--update`"),
    ("the folder of the `cases`", "the folder of the cases by --cases"),
    ("the log is said to be of a closed loop", "--loop closed"),
];

/// A message with the options that it is about.
pub(super) fn with_options(message: &str) -> String {
    let mut text = OPTIONS.iter().fold(message.to_owned(), |text, (words, option)| text.replace(words, option));
    // `resample(0.1)`, of a sample time that is suggested.
    while let Some((before, after)) = text.split_once("`resample(")
        && let Some((seconds, rest)) = after.split_once(")`")
    {
        text = format!("{before}`--resample {seconds}`{rest}");
    }
    text
}

/// A report whose notes name options.
pub(super) fn in_options(mut report: Report) -> Report {
    for pair in &mut report.pairs {
        pair.findings.iter_mut().for_each(|f| f.evidence = with_options(&f.evidence));
        pair.estimates.iter_mut().for_each(|e| e.note = e.note.as_deref().map(with_options));
    }
    report
}

#[cfg(test)]
mod tests {
    use super::with_options;
    use deadtime_delay::DelayError;
    use deadtime_log::{LogError, Place};

    #[test]
    fn a_remedy_names_the_option_that_is_typed() {
        let window = DelayError::MaxDelay { seconds: 9.0, step_s: 0.1, samples: 50 };
        assert!(with_options(&window.to_string()).starts_with("--max-delay 9 s: give"), "{window}");
        let uneven =
            LogError::UnevenTime { file: "a.csv".into(), place: Place::Row(7), time_s: 0.5, deviation_samples: 0.3, suggested_s: 0.125 };
        let said = with_options(&uneven.to_string());
        assert!(said.ends_with("with `--resample TS`, for instance `--resample 0.125`"), "{said}");
        let closed = with_options("the log is said to be of a closed loop");
        assert_eq!(closed, "--loop closed");
    }
}
