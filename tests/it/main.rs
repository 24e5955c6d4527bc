//! Every integration test in one binary, a module a file: one link instead of one a file.
//! `cargo test --test it gap::` runs one file's tests.
#![expect(clippy::disallowed_methods, reason = "references share no code with the program")]
// Helpers of tests may stop the test; the lints' own exception covers test functions only.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::too_many_lines)]

mod support;

mod angles;
#[cfg(feature = "cli")]
mod bad_effects;
#[cfg(feature = "cli")]
mod bad_equations;
#[cfg(feature = "cli")]
mod bad_gap;
#[cfg(feature = "cli")]
mod bad_input;
mod bands;
mod bjorklund;
mod black_box;
mod black_box_pushes;
mod black_box_restart;
mod blind;
#[cfg(feature = "cli")]
mod blind_program;
mod blind_run;
mod bounds;
mod budgets;
#[cfg(feature = "cli")]
mod checks;
#[cfg(feature = "cli")]
mod cli;
mod clocks;
#[cfg(feature = "cli")]
mod compare;
mod conditions;
mod contract;
mod correlation;
mod degenerate;
mod degenerate_gap;
#[cfg(feature = "cli")]
mod derived;
mod diagnosis;
mod differential;
mod durable;
#[cfg(feature = "cli")]
mod effect_list;
mod effects;
mod equations;
#[cfg(feature = "cli")]
mod events;
#[cfg(feature = "cli")]
mod export;
#[cfg(all(feature = "cli", unix))]
mod frequency;
mod fuzz;
#[cfg(feature = "cli")]
mod gap;
mod gap_bend;
mod gap_candidates;
mod gap_coarse;
mod gap_events;
#[cfg(feature = "cli")]
mod gap_handed;
mod gap_hard;
mod gap_held_out;
#[cfg(feature = "cli")]
mod gap_horizon;
mod gap_mixture;
#[cfg(feature = "cli")]
mod gap_moving;
mod gap_nominal;
mod gap_nuisances;
mod gap_numbers;
mod gap_rest;
mod gap_stepping;
mod gate;
mod golden;
mod golden_effects;
mod golden_estimators;
mod golden_signals;
mod higher_order;
mod identify;
#[cfg(feature = "cli")]
mod identify_program;
mod injected;
#[cfg(feature = "cli")]
mod isolability;
#[cfg(feature = "cli")]
mod log_files;
#[cfg(feature = "cli")]
mod machines;
mod matching;
#[cfg(feature = "cli")]
mod matching_program;
mod model_laws;
mod moving;
mod options;
mod outputs;
mod pairs;
mod phase_and_area;
mod predictor;
mod process;
#[cfg(feature = "cli")]
mod progress;
mod properties;
#[cfg(feature = "cli")]
mod readme;
#[cfg(feature = "cli")]
mod real_logs;
#[cfg(feature = "cli")]
mod report_html;
#[cfg(feature = "cli")]
mod report_pages;
#[cfg(feature = "cli")]
mod response;
mod richness;
mod sampled_models;
mod several_inputs;
#[cfg(all(feature = "cli", unix))]
mod simulator_program;
mod stateless;
#[cfg(feature = "cli")]
mod structured;
mod structures;
mod study;
mod study_bjorklund;
#[cfg(all(feature = "cli", feature = "tables"))]
mod study_parquet;
mod study_thesis;
#[cfg(feature = "cli")]
mod terminal;
mod thresholds;
mod transfer_files;
mod verdicts;
mod verdicts_loop;
mod watch;
mod wording;
