//! The clocks of topics: how even stamps are, and an offset between two topics where it can be told, and a reason where it cannot.

use deadtime::diagnose::{ClockOffset, clocks};
use deadtime::log::{Channel, Log, Recording, Topic, Wanted};
use deadtime::rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

const DURATION_S: f64 = 60.0;

/// A motion of many sines up to 4 Hz: its value and its slope at any time.
struct Motion(Vec<[f64; 3]>);

impl Motion {
    fn new(rng: &mut ChaCha8Rng, lines: usize) -> Self {
        Self(
            (0..lines)
                .map(|k| {
                    [
                        0.2 + 3.8 * (k as f64 + rng.random::<f64>()) / lines as f64,
                        std::f64::consts::TAU * rng.random::<f64>(),
                        0.5 + rng.random::<f64>(),
                    ]
                })
                .collect(),
        )
    }

    fn sum(&self, of: impl Fn(f64, f64) -> f64) -> f64 {
        self.0.iter().map(|[hz, phase, size]| size * of(std::f64::consts::TAU * hz, *phase)).sum()
    }

    fn at(&self, t: f64) -> f64 {
        self.sum(|w, p| (w * t + p).sin())
    }

    fn slope(&self, t: f64) -> f64 {
        self.sum(|w, p| w * (w * t + p).cos())
    }

    /// Behind a lag of `tau` s.
    fn lagged(&self, t: f64, tau: f64) -> f64 {
        self.sum(|w, p| (w * t + p - (w * tau).atan()).sin() / (1.0 + (w * tau).powi(2)).sqrt())
    }
}

/// A topic whose stamps jitter and are late by `late_s`; the measured value is that of the time without either.
fn topic(
    name: &str,
    rng: &mut ChaCha8Rng,
    step_s: f64,
    late_s: f64,
    noise: f64,
    value: impl Fn(f64) -> f64,
) -> Topic {
    let count = (DURATION_S / step_s) as usize;
    let time_s: Vec<f64> =
        (0..count).map(|k| step_s * (k as f64 + 0.2 * rng.random_range(-1.0..1.0))).collect();
    let values = time_s.iter().map(|t| value(*t) + noise * rng.random_range(-1.0..1.0)).collect();
    let stamps = time_s.iter().map(|t| t + late_s).collect();
    Topic {
        name: name.to_owned(),
        log: Log::new(name, stamps, vec![Channel::new("x", None, values)]).unwrap(),
    }
}

fn found(topics: Vec<Topic>) -> ClockOffset {
    let wanted: Vec<Wanted> = topics
        .iter()
        .map(|t| Wanted { name: format!("{}.x", t.name), held: false, required: false })
        .collect();
    let recording = Recording {
        source: "flight".into(),
        format: "test",
        topics,
        notes: deadtime::log::Notes::default(),
    };
    let mut found = clocks(&recording, &wanted);
    assert_eq!((found.topics.len(), found.offsets.len()), (2, 1));
    found.offsets.remove(0)
}

#[test]
fn an_offset_is_found_within_its_interval_at_any_rates_and_relations() {
    let mut inside = 0;
    for seed in 0..20 {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let motion = Motion::new(&mut rng, 60);
        let late_s = 0.05 * rng.random_range(-1.0..1.0);
        let first = topic("gyro", &mut rng, 0.004, 0.0, 0.3, |t| motion.at(t));
        let (words, second): (&str, Box<dyn Fn(f64) -> f64>) = match seed % 3 {
            0 => ("moves as `", Box::new(|t| motion.at(t))),
            1 => ("moves against", Box::new(|t| -2.0 * motion.at(t))),
            _ => ("as the derivative of", Box::new(|t| motion.slope(t))),
        };
        let second = topic("camera", &mut rng, 0.033, late_s, 0.3, second);
        let found = found(vec![first, second]);
        let [low, high] = found.ci95_s.unwrap_or_else(|| panic!("{seed}: {found:?}"));
        assert!(found.finding.contains(words), "{found:?}");
        assert!(
            (found.offset_s.unwrap() - late_s).abs() < 0.001 && high - low < 0.002,
            "{seed}, {late_s}: {found:?}"
        );
        inside += usize::from(low <= late_s && late_s <= high);
    }
    // 19 of 20 on average; 16 or fewer come by chance once in 60.
    assert!(inside >= 17, "{inside} of 20");
}

#[test]
fn what_cannot_be_told_is_said_with_the_reason() {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let motion = Motion::new(&mut rng, 60);
    let other = Motion::new(&mut rng, 60);
    let sine = Motion(vec![[1.0, 0.3, 1.0]]);
    let first = |rng: &mut ChaCha8Rng, of: &Motion| topic("a", rng, 0.01, 0.0, 0.01, |t| of.at(t));
    let cases: [(&str, Topic, Topic); 4] = [
        (
            "do not move alike",
            first(&mut rng, &motion),
            topic("b", &mut rng, 0.01, 0.0, 0.1, |t| other.at(t)),
        ),
        (
            "no straight line",
            first(&mut rng, &motion),
            topic("b", &mut rng, 0.01, 0.0, 0.01, |t| motion.lagged(t, 0.1)),
        ),
        (
            "wide enough band",
            first(&mut rng, &sine),
            topic("b", &mut rng, 0.01, 0.02, 0.01, |t| sine.at(t)),
        ),
        ("flat", first(&mut rng, &motion), topic("b", &mut rng, 0.01, 0.0, 0.0, |_| 1.0)),
    ];
    for (why, a, b) in cases {
        let found = found(vec![a, b]);
        assert_eq!((found.offset_s, found.ci95_s), (None, None), "{why}: {found:?}");
        assert!(
            found.finding.starts_with("undecided")
                && (found.finding.contains(why) || why == "flat"),
            "{why}: {found:?}"
        );
    }
    let short =
        Log::new("c", vec![0.0, 0.01, 0.02], vec![Channel::new("x", None, vec![1.0, 2.0, 0.0])])
            .unwrap();
    let found = found(vec![first(&mut rng, &motion), Topic { name: "c".into(), log: short }]);
    assert!(found.finding.contains("stretches"), "{found:?}");
}

#[test]
fn the_steps_of_every_topic_are_reported_by_their_quantiles() {
    let time_s = vec![0.0, 0.1, 0.2, 0.31, 0.4, 0.5, 0.6, 0.7, 0.8, 1.8];
    let log = Log::new("a", time_s, vec![Channel::new("x", None, vec![0.0; 10])]).unwrap();
    let recording = Recording {
        source: "a".into(),
        format: "csv",
        topics: vec![Topic { name: String::new(), log }],
        notes: deadtime::log::Notes::default(),
    };
    let found = clocks(
        &recording,
        &[
            Wanted { name: "x".into(), held: true, required: true },
            Wanted { name: "y".into(), held: false, required: false },
        ],
    );
    let topic = &found.topics[0];
    // numpy.quantile of the nine steps at 0.05, 0.5, 0.95.
    let [low, middle, high] = topic.steps_s.unwrap();
    assert!(
        (low - 0.094).abs() < 1e-9 && (middle - 0.1).abs() < 1e-9 && (high - 0.644).abs() < 1e-9,
        "{topic:?}"
    );
    assert!(
        (topic.longest_s.unwrap() - 1.0).abs() < 1e-9
            && found.offsets.is_empty()
            && topic.samples == 10
    );
}

#[cfg(feature = "cli")]
#[test]
fn check_reports_the_clocks_of_a_log() {
    use crate::support::program::{Folder, deadtime};
    let folder = Folder::new();
    let rows: String = (0..400)
        .map(|k| {
            format!(
                "{:.4},{},{}\n",
                0.01 * k as f64 + if k % 10 == 0 { 0.003 } else { 0.0 },
                k / 50 % 2,
                k % 7
            )
        })
        .collect();
    let log = folder.write("a.csv", &format!("time,u,y\n{rows}"));
    let model = folder.write(
        "m.toml",
        "format = \"deadtime/model@1\"\nname = \"lag\"\nkind = \"tf\"\ninputs = [{ name = \"u\" }]\noutputs = [{ name = \"y\" }]\n[[transfer]]\nnumerator = [1.0]\ndenominator = [0.1, 1.0]\n",
    );
    let json = folder.path("c.json");
    let run = deadtime(&[
        "check",
        "--model",
        model.to_str().unwrap(),
        "--log",
        log.to_str().unwrap(),
        "--json",
        json.to_str().unwrap(),
    ]);
    let said = run.done();
    assert!(
        said.contains("400 stamps, 0.01 s apart; 90 % of the steps 0.007 s to 0.013 s"),
        "{said}"
    );
    let found: deadtime::diagnose::Inspection =
        serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
    assert_eq!(found.clocks[0].topics[0].samples, 400);
}
