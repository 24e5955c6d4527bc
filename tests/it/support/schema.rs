//! Documents against the published schema of a diagnosis, by the reference environment's `jsonschema`.

use std::io::Write;
use std::process::{Command, Stdio};

use serde_json::{Value, json};

use super::outside::reference_python;

const SCHEMA: &str = include_str!("../../../docs/diagnosis.schema.json");
const VALIDATE: &str = "
import json, sys, jsonschema
given = json.load(sys.stdin)
jsonschema.Draft202012Validator.check_schema(given['schema'])
validator = jsonschema.Draft202012Validator(given['schema'])
json.dump([[e.message for e in validator.iter_errors(d)] for d in given['documents']], sys.stdout)
";

/// What the schema says against each document; `None` where the test is skipped for want of the reference environment.
pub(crate) fn violations(documents: &[Value]) -> Option<Vec<Vec<String>>> {
    let python = reference_python("jsonschema")?;
    let mut child = Command::new(python)
        .args(["-c", VALIDATE])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let schema: Value = serde_json::from_str(SCHEMA).unwrap();
    let given = json!({ "schema": schema, "documents": documents }).to_string();
    child.stdin.take().unwrap().write_all(given.as_bytes()).unwrap();
    let done = child.wait_with_output().unwrap();
    assert!(done.status.success(), "the schema is no schema");
    let found: Vec<Vec<String>> = serde_json::from_slice(&done.stdout).unwrap();
    assert_eq!(found.len(), documents.len());
    Some(found)
}

/// The schema accepts the document, or the test is skipped.
pub(crate) fn accepts(document: &Value) {
    if let Some(found) = violations(std::slice::from_ref(document)) {
        assert!(found[0].is_empty(), "{:?}", found[0]);
    }
}
