//! Model files of transfer functions, `kind = "tf"` and `kind = "zpk"`.

use std::path::Path;

use deadtime::model::{ModelDocument, ModelError};
use nalgebra::Complex;

const TF: &str = r#"
format = "deadtime/model@1"
name = "heater"
kind = "tf"
inputs = [{ name = "u" }, { name = "w" }]
outputs = [{ name = "y", operating = 20.0 }]
input_delay_s = [1.5, 0.0]
[[transfer]]
input = "u"
numerator = [3.0]
denominator = [4.0, 1.0]
[[transfer]]
input = "w"
numerator = [1.0, 2.0]
denominator = [1.0, 2.0, 5.0]
"#;

fn read(text: &str) -> Result<ModelDocument, ModelError> {
    ModelDocument::from_toml(text, Path::new("m.toml"))
}

#[test]
fn polynomials_and_zeros_and_poles_give_the_response_of_their_formula() {
    let zpk = TF
        .replace("\"tf\"", "\"zpk\"")
        .replace("numerator = [3.0]\ndenominator = [4.0, 1.0]", "poles = [-0.25]\ngain = 0.75")
        .replace(
            "numerator = [1.0, 2.0]\ndenominator = [1.0, 2.0, 5.0]",
            "zeros = [-2]\npoles = [[-1, 2], [-1, -2]]\ngain = 1",
        );
    for text in [TF, &zpk] {
        let ModelDocument::Lti(file) = read(text).unwrap() else { panic!("not linear") };
        let (omega, system) = (0.7, file.continuous().unwrap());
        let s = Complex::new(0.0, omega);
        let wanted =
            [(s * 4.0 + 1.0).inv() * 3.0 * (-s * 1.5).exp(), (s + 2.0) / (s * s + s * 2.0 + 5.0)];
        for (got, wanted) in system.frequency_response(omega).iter().zip(wanted) {
            assert!((got - wanted).norm() < 1e-12, "{got} {wanted}");
        }
        assert_eq!((file.input_delay_s.clone(), file.states.len()), (vec![1.5, 0.0], 3));
        // What is written is a linear model like any other.
        assert_eq!(read(&file.to_toml().unwrap()).unwrap(), ModelDocument::Lti(file));
    }
}

#[test]
fn faults_name_the_file_and_the_pair() {
    for (from, to, says) in [
        ("numerator = [3.0]", "numerator = [1.0, 0.0, 3.0]", "from u to y"),
        ("denominator = [4.0, 1.0]", "denominator = [0.0]", "from u to y"),
        ("denominator = [4.0, 1.0]", "gain = 2.0", "numerator and denominator"),
        ("\"tf\"", "\"zpk\"", "zeros, poles and gain"),
        ("input = \"w\"", "input = \"u\"", "two [[transfer]] entries"),
        ("input = \"w\"", "input = \"v\"", "there are: u, w"),
        ("input = \"w\"", "", "say which input"),
        ("input_delay_s = [1.5, 0.0]", "initial = [3.0]", "no initial state"),
        ("name = \"heater\"", "nmae = \"heater\"", "nmae"),
    ] {
        assert!(TF.contains(from));
        let message = read(&TF.replace(from, to)).unwrap_err().to_string();
        assert!(message.contains("m.toml") && message.contains(says), "{to}: {message}");
    }
}

#[test]
fn every_example_of_the_page_on_model_files_is_read() {
    let page =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/docs/models.md")).unwrap();
    let mut kinds = Vec::new();
    for block in page.split("```toml\n").skip(1) {
        let model = read(block.split("```").next().unwrap()).unwrap();
        kinds.push(model.name().to_owned());
    }
    assert_eq!(kinds, ["cart", "heater", "pendulum", "two heaters", "heater in a room"]);
}
