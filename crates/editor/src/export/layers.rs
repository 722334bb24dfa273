//! The light of a picture in parts: by light, or by kind of light. Together they are the picture.

use std::ops::Range;

use anyhow::Result;
use clap::ValueEnum;
use clerestory_relight::Radiance;
use clerestory_transport::bake::Bake;
use clerestory_transport::basis::{LightBasis, LightSource, SourceKind, SunApart};
use serde::{Deserialize, Serialize};

use crate::cli::relight::Relighter;
use crate::look::Look;
use crate::look::groups::own_name;

/// What one light or kind of light adds to a picture.
#[derive(Clone, Debug)]
pub struct LightLayer {
    /// Name of the light, the group or the kind.
    pub key: String,
    /// Its part of the picture.
    pub radiance: Radiance,
}

/// Into which parts the light is told apart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum LayerSet {
    /// None.
    #[default]
    None,
    /// By group of the look; lights without one by kind: lamps, luminous surfaces, panels, sky, unlit surfaces, free lamps.
    Groups,
    /// By light, as the look calls them.
    Lights,
}

/// Name of the layer of lamps that the scene does not have, where they are neither told apart nor in a group of the look.
pub const FREE_LAMPS: &str = "free lamps";

/// Name of the kind that a light belongs to.
fn kind_of(kind: SourceKind) -> &'static str {
    match kind {
        SourceKind::Point | SourceKind::Spot | SourceKind::Directional => "lamps",
        SourceKind::Emitter => "surfaces",
        SourceKind::Panel { .. } => "panels",
        SourceKind::Sky | SourceKind::Dome { .. } | SourceKind::Sun { .. } => "sky",
        SourceKind::Constant => "unlit",
        SourceKind::Image => "pictures",
    }
}

/// What the layer of a light is called: as the look calls it, its key where the look calls another light so.
pub fn layer_name(key: &str, look: &Look) -> String {
    let name = look.name_of(key);
    let is_shared = look.names.iter().any(|(other, of_other)| other != key && of_other == name);
    if is_shared { key.to_owned() } else { name.to_owned() }
}

/// What the panel of lights calls a group.
fn called<'a>(group: &'a str, look: &'a Look) -> &'a str {
    look.names.get(group).map_or_else(|| own_name(group), String::as_str)
}

/// What the layer of a group is called: as the panel of lights calls it, its key where it calls another one so.
fn group_name<'a>(group: &'a str, look: &'a Look) -> &'a str {
    let name = called(group, look);
    let is_shared = look.lights.groups.keys().any(|other| other != group && called(other, look) == name);
    if is_shared { group } else { name }
}

/// The same of the first group that holds a light.
fn group_of(light: &str, look: &Look) -> Option<String> {
    let (key, _) = look.lights.groups.iter().find(|(_, group)| group.lights.contains(light))?;
    Some(group_name(key, look).to_owned())
}

/// What the layer of a kind is called: with a number where a group is called so.
fn kind_name(kind: &str, look: &Look) -> String {
    let mut groups = look.lights.groups.keys().filter(|group| group.as_str() == kind || called(group, look) == kind);
    let is_taken = groups.any(|group| group_name(group, look) == kind);
    if is_taken { format!("{kind}#2") } else { kind.to_owned() }
}

impl LayerSet {
    /// Names of the parts, and the columns of each, in the order of the columns. Free lamps have none, unless they were made lights of
    /// the scene.
    pub fn parts(self, basis: &LightBasis, look: &Look) -> Vec<(String, Vec<Range<u32>>)> {
        let lamps = look.lights.shining_lamps();
        let kind_of = |source: &LightSource| {
            let is_free = lamps.iter().any(|lamp| lamp.key == source.key);
            if is_free { FREE_LAMPS } else { kind_of(source.kind) }
        };
        let mut parts: Vec<(String, Vec<Range<u32>>)> = Vec::new();
        for source in &basis.sources {
            let name = match self {
                LayerSet::None => continue,
                LayerSet::Lights => {
                    let name = layer_name(&source.key, look);
                    // Another light is called so by its key.
                    let is_taken =
                        name != source.key && !look.names.contains_key(&name) && basis.source(&name).is_some();
                    if is_taken { source.key.clone() } else { name }
                }
                LayerSet::Groups => group_of(&source.key, look).unwrap_or_else(|| kind_name(kind_of(source), look)),
            };
            match parts.iter_mut().find(|(other, _)| self == LayerSet::Groups && *other == name) {
                Some((_, columns)) => columns.push(source.columns.clone()),
                None => parts.push((name, vec![source.columns.clone()])),
            }
        }
        parts
    }

    /// Layers of free lamps, and the indices of those in each: told apart by light, else those of one group of the look together.
    pub fn lamp_parts(self, keys: &[&str], look: &Look) -> Vec<(String, Vec<usize>)> {
        let mut parts: Vec<(String, Vec<usize>)> = Vec::new();
        for (idx, key) in keys.iter().enumerate() {
            let name = match self {
                LayerSet::None => continue,
                LayerSet::Lights => layer_name(key, look),
                LayerSet::Groups => group_of(key, look).unwrap_or_else(|| kind_name(FREE_LAMPS, look)),
            };
            match parts.iter_mut().find(|(other, _)| self == LayerSet::Groups && *other == name) {
                Some((_, lamps)) => lamps.push(idx),
                None => parts.push((name, vec![idx])),
            }
        }
        parts
    }

    /// Takes in a layer of free lamps: the lights of the scene that are in their group have one already.
    pub fn take_in(self, layers: &mut Vec<LightLayer>, lamps: LightLayer) {
        let own = layers.iter_mut().find(|layer| self == LayerSet::Groups && layer.key == lamps.key);
        match own {
            Some(layer) => layer.radiance.add(&lamps.radiance),
            None => layers.push(lamps),
        }
    }

    /// The parts of a picture under some coefficients, one RGB per column and group; `relight` makes a picture of such. Columns
    /// of patches stay dark: their light is that of free lamps.
    ///
    /// # Errors
    /// As `relight`.
    pub fn layers(
        self,
        basis: &LightBasis,
        look: &Look,
        coefficients: &[Vec<[f32; 3]>],
        mut relight: impl FnMut(&[Vec<[f32; 3]>]) -> Result<Radiance>,
    ) -> Result<Vec<LightLayer>> {
        let alone = |columns: &[Range<u32>]| -> Vec<Vec<[f32; 3]>> {
            let kept = |column: u32| columns.iter().any(|range| range.contains(&column));
            let groups = basis.groups.iter().zip(coefficients);
            let group = groups.map(|(group, coefficients)| {
                let lit = group.columns.clone().zip(coefficients);
                lit.map(|(column, rgb)| if kept(column) { *rgb } else { [0.0; 3] }).collect()
            });
            group.collect()
        };
        let parts = self.parts(basis, look).into_iter();
        parts.map(|(key, columns)| Ok(LightLayer { key, radiance: relight(&alone(&columns))? })).collect()
    }

    /// The parts of the picture of a bake where a sun shines from columns of the sky, on the CPU: without it each column is of one
    /// light, and its own light is added to its part.
    ///
    /// # Errors
    /// A bake without blocks that can be multiplied.
    pub fn layers_with_sun(self, bake: &Bake, look: &Look, sun: &SunApart) -> Result<Vec<LightLayer>> {
        if self == LayerSet::None {
            return Ok(Vec::new());
        }
        let (header, basis) = (&bake.header, &bake.header.basis);
        let mut without = Relighter::new(bake, &sun.without, None)?;
        let coefficients = header.coefficients(&sun.without);
        let mut layers = self.layers(basis, look, &coefficients, |coefficients| without.relight(coefficients))?;
        let of_sun = Relighter::new(bake, &sun.alone, None)?.relight(&header.coefficients(&sun.alone))?;
        let nth = self.parts(basis, look).iter().position(|(_, columns)| columns.contains(&sun.source.columns));
        if let Some(layer) = nth.and_then(|nth| layers.get_mut(nth)) {
            layer.radiance.add(&of_sun);
        }
        Ok(layers)
    }
}

#[cfg(test)]
mod tests {
    use clerestory_transport::light::LightGroup;

    use super::*;
    use crate::support::lamp;

    fn basis() -> LightBasis {
        let source = |key: &str, kind, n_columns| {
            let columns = 0..n_columns;
            LightSource::plain(key, kind, columns)
        };
        LightBasis::new(vec![
            source("desk", SourceKind::Point, 1),
            source("screen", SourceKind::Emitter, 1),
            source("wall", SourceKind::Spot, 1),
            source("sky", SourceKind::Sky, 1),
            source("ceiling", SourceKind::Panel { resolution: 4, size_m: [1.0; 2] }, 16),
        ])
    }

    fn names_of(set: LayerSet, basis: &LightBasis, look: &Look) -> Vec<String> {
        set.parts(basis, look).into_iter().map(|(name, _)| name).collect()
    }

    #[test]
    fn kinds_gather_their_lights_and_every_column_is_in_one_part() {
        let basis = basis();
        let names = |set: LayerSet| names_of(set, &basis, &Look::default());
        assert_eq!(names(LayerSet::Groups), ["lamps", "surfaces", "sky", "panels"]);
        assert_eq!(names(LayerSet::Lights), ["desk", "screen", "wall", "sky", "ceiling"]);
        assert!(names(LayerSet::None).is_empty());
        let mut look = Look::default();
        let lights = ["desk", "ceiling"].map(String::from).into();
        look.lights.groups.insert("work".into(), LightGroup { lights, intensity: 1.0, muted: false });
        look.names.insert("desk".into(), "Desk lamp".into());
        look.names.insert("wall".into(), "screen".into());
        look.names.insert("screen".into(), "screen".into());
        let names = |set: LayerSet| names_of(set, &basis, &look);
        assert_eq!(names(LayerSet::Groups), ["work", "surfaces", "lamps", "sky"]);
        assert_eq!(names(LayerSet::Lights), ["Desk lamp", "screen", "wall", "sky", "ceiling"]);
        look.lights.groups.insert("place:Hall/Table".into(), look.lights.groups["work"].clone());
        look.lights.groups.remove("work");
        assert_eq!(names_of(LayerSet::Groups, &basis, &look)[0], "Table");
        look.names.insert("place:Hall/Table".into(), "Work".into());
        assert_eq!(names_of(LayerSet::Groups, &basis, &look)[0], "Work");
        let other = LightGroup { lights: ["sky".to_owned()].into(), intensity: 1.0, muted: false };
        look.lights.groups.insert("name:Work".into(), other);
        assert_eq!(names_of(LayerSet::Groups, &basis, &look)[..3], ["place:Hall/Table", "surfaces", "lamps"]);
        for set in [LayerSet::Groups, LayerSet::Lights] {
            let mut columns: Vec<u32> =
                set.parts(&basis, &look).into_iter().flat_map(|(_, ranges)| ranges).flatten().collect();
            columns.sort_unstable();
            assert_eq!(columns, (0..basis.n_cols() as u32).collect::<Vec<_>>());
        }
    }

    #[test]
    fn a_group_that_is_called_as_a_kind_holds_its_own_lights_alone() {
        let (basis, mut look) = (basis(), Look::default());
        for (name, light) in [("lamps", "desk"), (FREE_LAMPS, "Lamp 1")] {
            let lights = [light.to_owned()].into();
            look.lights.groups.insert(name.into(), LightGroup { lights, intensity: 1.0, muted: false });
        }
        assert_eq!(names_of(LayerSet::Groups, &basis, &look), ["lamps", "surfaces", "lamps#2", "sky", "panels"]);
        let parts = LayerSet::Groups.lamp_parts(&["Lamp 1", "Lamp 2"], &look);
        assert_eq!(parts, [(FREE_LAMPS.to_owned(), vec![0]), (format!("{FREE_LAMPS}#2"), vec![1])]);
    }

    #[test]
    fn a_light_that_is_called_as_another_one_has_a_layer_of_its_own() {
        let (basis, mut look) = (basis(), Look::default());
        look.names.insert("wall".into(), "screen".into());
        let keys = ["desk", "screen", "wall", "sky", "ceiling"];
        assert_eq!(names_of(LayerSet::Lights, &basis, &look), keys);
        look.names.insert("screen".into(), "wall".into());
        assert_eq!(names_of(LayerSet::Lights, &basis, &look), ["desk", "wall", "screen", "sky", "ceiling"]);
    }

    #[test]
    fn free_lamps_go_with_the_group_of_the_look_that_has_them() {
        let mut look = Look::default();
        let lights = ["desk", "Lamp 1"].map(String::from).into();
        look.lights.groups.insert("work".into(), LightGroup { lights, intensity: 1.0, muted: false });
        let parts = |set: LayerSet| set.lamp_parts(&["Lamp 1", "Lamp 2", "Lamp 3"], &look);
        assert_eq!(parts(LayerSet::Groups), [("work".to_owned(), vec![0]), (FREE_LAMPS.to_owned(), vec![1, 2])]);
        assert_eq!((parts(LayerSet::Lights).len(), parts(LayerSet::None).len()), (3, 0));
        let layer = |key: &str, light: f32| {
            let radiance = Radiance { width: 1, height: 1, pixels: vec![[light; 3]] };
            LightLayer { key: key.into(), radiance }
        };
        let mut layers = vec![layer("work", 1.0)];
        LayerSet::Groups.take_in(&mut layers, layer("work", 2.0));
        LayerSet::Groups.take_in(&mut layers, layer(FREE_LAMPS, 4.0));
        LayerSet::Lights.take_in(&mut layers, layer("work", 8.0));
        let told = layers.iter().map(|layer| (layer.key.as_str(), layer.radiance.pixels[0][0]));
        assert_eq!(told.collect::<Vec<_>>(), [("work", 3.0), (FREE_LAMPS, 4.0), ("work", 8.0)]);
    }

    #[test]
    fn free_lamps_that_were_made_lights_of_the_scene_are_a_kind_of_their_own() {
        let source = |key: &str, kind| LightSource::plain(key, kind, 0..1);
        let basis = LightBasis::new(vec![
            source("desk", SourceKind::Point),
            source("Lamp 1", SourceKind::Point),
            source("Lamp 2", SourceKind::Emitter),
        ]);
        let mut look = Look::default();
        look.lights.lamps = ["Lamp 1", "Lamp 2"].map(lamp).into();
        assert_eq!(names_of(LayerSet::Groups, &basis, &look), ["lamps", FREE_LAMPS]);
        assert_eq!(names_of(LayerSet::Lights, &basis, &look), ["desk", "Lamp 1", "Lamp 2"]);
        let lights = ["Lamp 2".to_owned()].into();
        look.lights.groups.insert("work".into(), LightGroup { lights, intensity: 1.0, muted: false });
        assert_eq!(names_of(LayerSet::Groups, &basis, &look), ["lamps", FREE_LAMPS, "work"]);
    }

    #[test]
    fn a_layer_is_the_picture_under_its_own_coefficients_alone() {
        let basis = basis();
        let all = basis.split_by_group(&vec![[1.0, 2.0, 3.0]; basis.n_cols()]);
        let sum = |coefficients: &[Vec<[f32; 3]>]| {
            let sum = coefficients.iter().flatten().fold([0.0; 3], |sum, c| std::array::from_fn(|i| sum[i] + c[i]));
            Ok(Radiance { width: 1, height: 1, pixels: vec![sum] })
        };
        let layers = LayerSet::Groups.layers(&basis, &Look::default(), &all, sum).unwrap();
        let reds: Vec<f32> = layers.iter().map(|layer| layer.radiance.pixels[0][0]).collect();
        assert_eq!(reds, [2.0, 1.0, 1.0, 16.0]);
    }
}
