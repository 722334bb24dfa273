//! Lights that are off in the file come back with what they keep.

use glam::Vec3;
use serde_json::{Value, json};

use super::fixture::Fixture;
use crate::emitters::Lighting;
use crate::import::Imported;
use crate::light::LightRig;

/// A node called `n` with a lamp and a triangle, both dark, that keeps something.
fn dark(muted: Value) -> Fixture {
    let node = json!({
        "name": "n", "extensions": {"KHR_lights_punctual": {"light": 0}}, "extras": {"clerestory": {"muted": muted}},
    });
    let mut fixture = Fixture::triangle().material(json!({"emissiveFactor": [0, 0, 0]})).node(node);
    fixture.root["extensions"] =
        json!({"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 0, "color": [1, 1, 0]}]}});
    fixture
}

fn kept() -> Value {
    json!({"lamp": {"color": [1, 0.5, 0], "strength": 40}, "surfaces": [{"color": [0, 1, 0.25], "strength": 8}]})
}

fn lighting(imported: &Imported) -> Lighting {
    Lighting::new(&imported.scene, &[]).expect("its lights").0
}

#[test]
fn muted_lights_are_what_they_are_when_they_are_on() {
    let imported = dark(kept()).load();
    assert!(imported.report.warnings.is_empty(), "{:?}", imported.report.warnings);
    let basis = lighting(&imported).basis;
    let strengths: Vec<_> = basis.sources.iter().map(|source| (source.key.as_str(), source.strength)).collect();
    assert_eq!(strengths, [("n", 40.0), ("n#2", 8.0)]);
    assert_eq!(basis.project(&LightRig::default()), [[40.0, 20.0, 0.0], [0.0, 8.0, 2.0]]);
    assert!(basis.project(&basis.file_rig()).iter().all(|light| *light == [0.0; 3]), "both are off");
}

#[test]
fn what_shines_in_the_file_is_not_muted() {
    let mut fixture = dark(kept());
    fixture.root["extensions"]["KHR_lights_punctual"]["lights"][0]["intensity"] = json!(5);
    fixture.root["materials"][0]["emissiveFactor"] = json!([0.5, 0.5, 0.5]);
    let imported = fixture.load();
    let basis = lighting(&imported).basis;
    assert!(basis.muted.is_empty() && imported.report.warnings.is_empty(), "{:?}", imported.report.warnings);
    assert_eq!(basis.project(&LightRig::default()), [[5.0, 5.0, 0.0], [0.5; 3]]);
}

#[test]
fn nodes_that_share_a_surface_are_muted_one_by_one() {
    let mut fixture = dark(kept());
    let mut others = vec![fixture.root["nodes"][0].clone(), json!({"name": "dark", "mesh": 0})];
    others[0]["name"] = json!("other");
    others[0]["extras"]["clerestory"]["muted"]["surfaces"][0]["strength"] = json!(3);
    fixture.root["nodes"].as_array_mut().expect("a list").extend(others);
    fixture.root["scenes"][0]["nodes"] = json!([0, 1, 2]);
    let basis = lighting(&fixture.load()).basis;
    let strengths: Vec<_> = basis.sources.iter().map(|source| (source.key.as_str(), source.strength)).collect();
    assert_eq!(strengths, [("n", 40.0), ("n#2", 8.0), ("other", 40.0), ("other#2", 3.0)]);
    assert_eq!(basis.muted.len(), 4);
}

#[test]
fn what_cannot_be_read_is_told_and_stays_dark() {
    let light = |color: Value, strength: Value| json!({"lamp": {"color": color, "strength": strength}});
    let odd = [
        json!(true),
        json!(null),
        json!({"lamp": 40}),
        light(json!([1, 1]), json!(40)),
        light(json!([1, 1, -1]), json!(40)),
        light(json!([1, 1, 1]), json!(-40)),
        light(json!([1, 1, 1]), json!(1e300)),
        light(json!([0, 0, 0]), json!(40)),
        json!({"surfaces": {"color": [1, 1, 1], "strength": 40}}),
        json!({"surfaces": [null, {"color": [1, 1, 1], "strength": 40}]}),
        json!({"surfaces": [{"color": "white", "strength": 40}]}),
    ];
    for muted in odd {
        let imported = dark(muted.clone()).load();
        let told = &imported.report.warnings;
        assert!(
            matches!(told.as_slice(), [one] if one.contains("\"n\"") && one.contains("stay dark")),
            "{muted}: {told:?}"
        );
        let basis = lighting(&imported).basis;
        assert!(basis.muted.is_empty() && imported.scene.punctual[0].intensity == 0.0, "{muted}");
    }
    let mut fixture = dark(kept());
    fixture.root["nodes"][0] = json!({"name": "n", "extras": fixture.root["nodes"][0]["extras"]});
    let imported = fixture.node(json!({"mesh": 0})).load();
    assert!(imported.report.warnings[0].contains("does not have"), "{:?}", imported.report.warnings);
    assert_eq!(
        imported.scene.materials[0].emitted_radiance(),
        Vec3::new(0.0, 8.0, 2.0),
        "its surface is another matter"
    );
}
