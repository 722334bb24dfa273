//! Vertices stand where their joints do, and where their node does if its skin is of no use.

use glam::Vec3;
use serde_json::{Value, json};

use super::fixture::Fixture;
use crate::import::Imported;

const IDENTITY: [f32; 16] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];

fn expect(imported: &Imported, positions: &[Vec3]) {
    let got = &imported.scene.mesh.positions;
    let near = got.len() == positions.len() && got.iter().zip(positions).all(|(a, b)| a.distance(*b) < 1e-6);
    assert!(near, "{got:?}, not {positions:?}");
}

/// Gives the only primitive joints by 8 bits and weights.
fn hang(fixture: &mut Fixture, joints: &[[u8; 4]], weights: &[[f32; 4]]) {
    let joints = fixture.accessor("VEC4", 5121, joints.len(), joints.as_flattened());
    let weights = fixture.floats("VEC4", weights.as_flattened());
    fixture.primitive()["attributes"]["JOINTS_0"] = json!(joints);
    fixture.primitive()["attributes"]["WEIGHTS_0"] = json!(weights);
}

/// The triangle of a node that makes it a hundred times as large, on a joint that makes it a hundredth.
fn small(x_scale: f32) -> Fixture {
    let mut fixture = Fixture::triangle();
    hang(&mut fixture, &[[0; 4]; 3], &[[1.0, 0.0, 0.0, 0.0]; 3]);
    fixture.root["nodes"] = json!([
        {"mesh": 0, "skin": 0, "scale": [100, 100, 100], "translation": [7, 7, 7]},
        {"scale": [x_scale, 0.01, 0.01], "translation": [0, 0, 5]},
    ]);
    fixture.root["scenes"][0]["nodes"] = json!([0, 1]);
    fixture.root["skins"] = json!([{"joints": [1]}]);
    fixture
}

#[test]
fn the_transform_of_a_skinned_node_counts_for_nothing() {
    for x_scale in [0.01, -0.01] {
        let imported = small(x_scale).load();
        let [a, b, c] = [Vec3::ZERO, Vec3::X * x_scale, Vec3::Y * 0.01].map(|at| at + 5.0 * Vec3::Z);
        expect(&imported, &[a, b, c]);
        assert_eq!(imported.scene.mesh.area_normal(0).normalize(), Vec3::Z, "its front stays its front");
        assert!(imported.report.warnings.is_empty() && imported.report.unsupported.is_empty(), "{:?}", imported.report);
    }
}

/// A bar from y = 0 to 2 with a joint at each end of its lower half; the upper one is turned by a quarter about +Z.
fn bar() -> Fixture {
    let corners = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0], [0.0, 2.0], [1.0, 2.0]];
    let mut fixture = Fixture::mesh(&corners.map(|[x, y]| [x, y, 0.0]));
    let normals = fixture.floats("VEC3", &[1.0, 0.0, 0.0].repeat(6));
    fixture.primitive()["attributes"]["NORMAL"] = json!(normals);
    let corners = fixture.accessor("SCALAR", 5121, 12, &[0, 1, 2, 1, 3, 2, 2, 3, 4, 3, 5, 4]);
    fixture.primitive()["indices"] = json!(corners);
    // The weights of a vertex need not add up to 1, and a joint without weight need not exist.
    let (below, between, above) = ([1.0, 0.0, 0.0, 0.0], [0.2, 0.2, 0.0, 0.0], [0.0, 3.0, 0.0, 0.0]);
    hang(&mut fixture, &[[0, 1, 9, 9]; 6], &[below, below, between, between, above, above]);
    let mut matrices = [IDENTITY; 2];
    matrices[1][13] = -1.0;
    let matrices = fixture.floats("MAT4", matrices.as_flattened());
    let half = std::f32::consts::FRAC_1_SQRT_2;
    fixture.root["nodes"] = json!([
        {"mesh": 0, "skin": 0, "translation": [0, 0, 3]},
        {"children": [2]},
        {"translation": [0, 1, 0], "rotation": [0, 0, half, half]},
    ]);
    fixture.root["scenes"][0]["nodes"] = json!([0, 1]);
    fixture.root["skins"] = json!([{"joints": [1, 2], "inverseBindMatrices": matrices}]);
    fixture
}

#[test]
fn a_bar_bends_between_its_joints() {
    let imported = bar().load();
    let known = [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [0.5, 1.5], [-1.0, 1.0], [-1.0, 2.0]];
    expect(&imported, &known.map(|[x, y]| Vec3::new(x, y, 0.0)));
    let normals = &imported.scene.mesh.normals;
    for (v, normal) in [(0, Vec3::X), (2, (Vec3::X + Vec3::Y).normalize()), (5, Vec3::Y)] {
        assert!(normals[v].distance(normal) < 1e-6, "{normals:?}");
    }
    assert!(imported.report.warnings.is_empty(), "{:?}", imported.report);
}

#[test]
fn vertices_may_hang_on_more_than_four_joints() {
    let mut fixture = bar();
    let mut more = fixture.primitive()["attributes"].clone();
    hang(&mut fixture, &[[1, 9, 9, 9]; 6], &[[1.0, 0.0, 0.0, 0.0]; 6]);
    let second = fixture.primitive()["attributes"].clone();
    more["JOINTS_1"] = second["JOINTS_0"].clone();
    more["WEIGHTS_1"] = second["WEIGHTS_0"].clone();
    for (third, told) in [(None, 0), (Some("JOINTS_2"), 1)] {
        let mut fixture = fixture.clone();
        fixture.primitive()["attributes"] = more.clone();
        if let Some(third) = third {
            fixture.primitive()["attributes"][third] = second["JOINTS_0"].clone();
        }
        let imported = fixture.load();
        // (0, 0) is where it was by the joint below, and (1, 1) by the one above.
        let at = imported.scene.mesh.positions[0];
        assert!(at.distance(Vec3::new(0.5, 0.5, 0.0)) < 1e-6, "{at}");
        let tells = |line: &&String| line.contains("joints of a vertex beyond the eighth");
        let unsupported = &imported.report.unsupported;
        assert_eq!(unsupported.iter().filter(tells).count(), told, "{unsupported:?}");
    }
}

#[test]
fn a_skin_that_is_of_no_use_leaves_its_mesh_to_the_node() {
    type Breaks = fn(&mut Value);
    let breaks: [(Breaks, &str); 6] = [
        (|root| root["skins"][0]["joints"] = json!([1]), "joint 1 of 1"),
        (|root| root["skins"][0]["joints"] = json!([1, 2, 1]), "2 matrices for 3 joints"),
        (|root| root["skins"][0]["joints"] = json!([1, 77]), "node 77"),
        (|root| root["skins"][0]["inverseBindMatrices"] = json!(0), "does not hold"),
        (|root| root["skins"] = json!([7]), "skin 0 cannot be read"),
        (|root| root["nodes"][0]["skin"] = json!(4), "skin 4 does not exist"),
    ];
    for (change, words) in breaks {
        let mut fixture = bar();
        change(&mut fixture.root);
        let imported = fixture.load();
        assert_eq!(imported.scene.mesh.positions[5], Vec3::new(1.0, 2.0, 3.0), "{words}");
        let told = |line: &String| line.contains(words) && line.ends_with("it stands where its node does");
        assert!(imported.report.warnings.iter().any(told), "{words}: {:?}", imported.report.warnings);
    }
}
