//! The verdict on a pair, its grounds, and the record's facts behind it.

/// The dead time, or none, and a sentence with the reason.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Verdict {
    /// The dead time, s; `None` without a trusted estimate.
    pub delay_s: Option<f64>,
    /// Its 95 % interval, s.
    pub ci95_s: Option<[f64; 2]>,
    /// The reason.
    pub why: String,
    /// The method with the largest weight.
    #[serde(skip)]
    pub method: Option<String>,
    /// Which of the methods used agree, and which differ.
    #[serde(skip)]
    pub grounds: Grounds,
}

impl Verdict {
    /// No dead time, for this reason.
    pub(crate) fn none(why: String) -> Self {
        Self { delay_s: None, ci95_s: None, why, method: None, grounds: Grounds::default() }
    }

    /// One more reason why the value may be unusable.
    pub(crate) fn doubt(&mut self, words: &str) {
        self.grounds.doubt(&mut self.why, words);
    }
}

/// The agreeing and the disagreeing methods of a verdict.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Grounds {
    /// Methods that agree on the delay, the one with the largest weight first.
    pub agree: Vec<String>,
    /// The others used, with the delay of each, s.
    pub differ: Vec<(String, f64)>,
    /// The output reacts within the sample, and the sentence names a direct path.
    pub direct: bool,
    /// Why the value may be unusable.
    pub doubts: Vec<String>,
}

impl Grounds {
    /// One more reason why the value may be unusable, appended to the sentence `why`.
    pub(super) fn doubt(&mut self, why: &mut String, words: &str) {
        why.push_str(&format!("; {words}"));
        self.doubts.push(words.to_owned());
    }
}

/// Facts of the record that no method's estimate contains.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RecordFacts {
    /// The largest apparent lead of a response, s: the log was resampled onto another grid, or its input logged less often than its output.
    pub early_s: f64,
    /// The output reacts to the input within the sample.
    pub direct: bool,
    /// The input moves once.
    pub one_step: bool,
    /// Other inputs have visible effects: models of all inputs resolve the fraction; the other methods use the output without those effects.
    pub others_act: bool,
}
