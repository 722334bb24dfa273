//! The columns of the matrix: which lights exist, which columns they own, and how a rig becomes coefficients.
//!
//! Every column is baked white at intensity 1, so that a red lamp can turn blue afterwards. What the file says about a
//! light stands beside it as `color` and `strength` and comes back in [`LightBasis::project`].

use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::ops::Range;

use clerestory_nystrom::ColumnRun;
use glam::{Vec2, Vec3};
use serde::{Deserialize, Serialize};

use crate::light::{LightRig, LightSetting, PanelSpot, luminance};
use crate::origin::LightOrigin;
use crate::scene::PunctualKind;
use crate::sky::SkyLight;

/// Texels along a panel of which neighbors count as such.
const MOST_TEXELS: u32 = 256;

/// What kind of light a column belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ColumnKind {
    /// One column per punctual lamp, per node with an emissive surface, and per picture of a measured stack.
    Luminaire,
    /// A rectangle of texels, one column each.
    Panel,
    /// The sky: one column, or one per patch of a dome and one for what is seen of it.
    Sky,
    /// What is seen whatever the lights do: unlit surfaces, one column.
    Constant,
    /// Light that free lamps throw on surfaces, see [`crate::patches`]: no light of the scene owns these columns.
    Patch,
}

/// What emits, as far as a designer needs to know.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SourceKind {
    /// Point lamp; strength in candela.
    Point,
    /// Spot lamp; strength in candela.
    Spot,
    /// Directional lamp; strength in lux.
    Directional,
    /// Emissive surfaces of a node; strength multiplies the color to nit.
    Emitter,
    /// Rectangle of `resolution` × `resolution` texels; strength multiplies the color to nit.
    Panel {
        /// Texels along each side.
        resolution: u32,
        /// Length of the u and v sides in meters.
        size_m: [f32; 2],
    },
    /// The whole sky in one column, uniform or a map as it is; strength multiplies it to nit.
    Sky,
    /// The sky in patches, and a last column for what the camera sees of it; strength multiplies the map to nit.
    Dome {
        /// Divisions of the sides of Tregenza's patches.
        divisions: u32,
    },
    /// The disk of the sun; strength is the illuminance on a surface that faces it, in lux.
    Sun {
        /// Unit vector towards it.
        direction: Vec3,
    },
    /// Unlit surfaces; strength multiplies their base color to nit.
    Constant,
    /// A light that was photographed; strength 1 is the picture as it was taken.
    Image,
}

impl From<PunctualKind> for SourceKind {
    fn from(kind: PunctualKind) -> Self {
        match kind {
            PunctualKind::Point => SourceKind::Point,
            PunctualKind::Spot { .. } => SourceKind::Spot,
            PunctualKind::Directional => SourceKind::Directional,
        }
    }
}

impl SourceKind {
    /// The kind of the columns of such a source.
    pub fn column_kind(self) -> ColumnKind {
        match self {
            SourceKind::Panel { .. } => ColumnKind::Panel,
            SourceKind::Sky | SourceKind::Dome { .. } => ColumnKind::Sky,
            SourceKind::Constant => ColumnKind::Constant,
            _ => ColumnKind::Luminaire,
        }
    }

    /// Unit of the strength, for people.
    pub fn unit(self) -> &'static str {
        match self {
            SourceKind::Point | SourceKind::Spot => "cd",
            SourceKind::Directional | SourceKind::Sun { .. } => "lx",
            SourceKind::Image => "of the picture",
            _ => "nit",
        }
    }
}

/// A light with a name of its own.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct LightSource {
    /// Name in looks: the node's name; repeats carry `#2`, `#3`, unnamed ones are `node:INDEX`.
    pub key: String,
    /// What emits.
    pub kind: SourceKind,
    /// Its columns. A panel's texel (i, j), i along u, is column `start + j · resolution + i`.
    pub columns: Range<u32>,
    /// Linear Rec. 709 color in the file.
    pub color: Vec3,
    /// Strength in the file, in the unit of the kind.
    pub strength: f32,
    /// Where it comes from.
    #[serde(default)]
    pub origin: LightOrigin,
}

impl LightSource {
    /// White, of strength 1 and of no node.
    pub fn plain(key: impl Into<String>, kind: SourceKind, columns: Range<u32>) -> LightSource {
        LightSource { key: key.into(), kind, columns, color: Vec3::ONE, strength: 1.0, origin: LightOrigin::default() }
    }

    /// Luminous flux in lumen that some spots leave of a panel under a setting; `None` of what is no panel, and where the flux of the whole
    /// is not known. As in [`LightSource::amount`] a muted light counts as if it were not.
    pub fn lumens_of_spots(&self, setting: &LightSetting, spots: &[PanelSpot]) -> Option<f32> {
        let SourceKind::Panel { resolution, size_m } = self.kind else { return None };
        let mut texels = vec![[0.0; 3]; self.columns.len()];
        project_spots(self, LightSetting { muted: false, ..*setting }, resolution, size_m, spots, &mut texels);
        let sum: f32 = texels.iter().map(|rgb| luminance(Vec3::from(*rgb))).sum();
        Some(sum / texels.len() as f32 * self.origin.lumens?)
    }

    /// Whether lights are the same in the same columns. How bright unlit surfaces are is reckoned from the light of the file, on another
    /// machine maybe with other rounding: that counts for nothing.
    pub(crate) fn are_alike(a: &[LightSource], b: &[LightSource]) -> bool {
        a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.is_alike(b))
    }

    /// Whether lights are the same, but for how bright unlit surfaces are, in whatever order: a bake that took columns over from an earlier
    /// one has its new lights behind the others.
    pub fn are_alike_in_any_order(a: &[LightSource], b: &[LightSource]) -> bool {
        let by_key: HashMap<&str, &LightSource> = b.iter().map(|source| (source.key.as_str(), source)).collect();
        let is_there = |source: &LightSource| {
            let moved = |other: &LightSource| LightSource { columns: other.columns.clone(), ..source.clone() };
            let found = by_key.get(source.key.as_str()).filter(|other| other.columns.len() == source.columns.len());
            found.is_some_and(|other| moved(other).is_alike(other))
        };
        a.len() == b.len() && a.iter().all(is_there)
    }

    fn is_alike(&self, other: &LightSource) -> bool {
        match self.kind {
            SourceKind::Constant => LightSource { strength: other.strength, ..self.clone() } == *other,
            _ => self == other,
        }
    }
}

/// Why an entry of a rig changes nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Unheeded {
    /// No light has that key.
    Unknown,
    /// Spots on a light that is no panel.
    NoPanel,
    /// A free lamp with the name of a light that has columns.
    Taken,
}

/// Neighboring columns that are compressed together.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ColumnGroup {
    /// Kind of all its columns.
    pub kind: ColumnKind,
    /// Its columns.
    pub columns: Range<u32>,
}

/// All columns: lights in order, luminaires first, then sky, unlit surfaces, and panels; last those of patches, if any.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LightBasis {
    /// Lights in the order of their columns.
    pub sources: Vec<LightSource>,
    /// Groups in the order of their columns: all luminaires, sky, unlit surfaces, each panel, patches.
    pub groups: Vec<ColumnGroup>,
    /// The sky of the bake, if it has one of its own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sky: Option<SkyLight>,
    /// Spots that the file marks on its panels, by key; a rig's own take their place.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub spots: BTreeMap<String, Vec<PanelSpot>>,
    /// Keys of lights that are off in the file; see [`LightBasis::file_rig`].
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub muted: BTreeSet<String>,
}

impl LightBasis {
    /// Puts sources in column order (`columns` of the argument counts only by its length) and forms the groups.
    pub fn new(mut sources: Vec<LightSource>) -> LightBasis {
        let order = |kind: ColumnKind| match kind {
            ColumnKind::Luminaire => 0,
            ColumnKind::Sky => 1,
            ColumnKind::Constant => 2,
            ColumnKind::Panel => 3,
            ColumnKind::Patch => 4,
        };
        sources.sort_by_key(|source| order(source.kind.column_kind()));
        let mut groups: Vec<ColumnGroup> = Vec::new();
        let mut next = 0;
        for source in &mut sources {
            source.columns = next..next + source.columns.len() as u32;
            next = source.columns.end;
            let kind = source.kind.column_kind();
            match groups.last_mut() {
                Some(group) if group.kind == kind && kind == ColumnKind::Luminaire => group.columns.end = next,
                _ => groups.push(ColumnGroup { kind, columns: source.columns.clone() }),
            }
        }
        LightBasis { sources, groups, ..LightBasis::default() }
    }

    /// Whether columns and lights are the same, see [`LightSource::are_alike`].
    pub(crate) fn is_alike(&self, other: &LightBasis) -> bool {
        LightSource::are_alike(&self.sources, &other.sources)
            && *other == LightBasis { sources: other.sources.clone(), ..self.clone() }
    }

    /// Whether its columns are those of a scene's lights, in the same groups; columns of patches may stand behind them.
    pub(crate) fn has_lights_of(&self, scene: &LightBasis) -> bool {
        let groups = self.groups.iter().filter(|group| group.kind != ColumnKind::Patch);
        LightSource::are_alike(&self.sources, &scene.sources) && groups.eq(&scene.groups)
    }

    /// Number of columns.
    pub fn n_cols(&self) -> usize {
        let of_lights = self.sources.last().map_or(0, |source| source.columns.end as usize);
        self.patch_columns().map_or(of_lights, |columns| columns.end as usize)
    }

    /// The columns of patches, if there are any. [`LightBasis::project`] leaves them dark: their coefficients are those of
    /// [`crate::patches::Patches::coefficients`].
    pub fn patch_columns(&self) -> Option<Range<u32>> {
        self.groups.last().filter(|group| group.kind == ColumnKind::Patch).map(|group| group.columns.clone())
    }

    /// The same lights and columns of patches behind them.
    pub(crate) fn with_patches(mut self, n_columns: u32) -> LightBasis {
        let start = self.n_cols() as u32;
        self.groups.push(ColumnGroup { kind: ColumnKind::Patch, columns: start..start + n_columns });
        self
    }

    /// Whether the columns are pictures that were taken, not light that was traced.
    pub fn is_measured(&self) -> bool {
        self.sources.iter().any(|source| source.kind == SourceKind::Image)
    }

    /// The light with that key.
    pub fn source(&self, key: &str) -> Option<&LightSource> {
        self.sources.iter().find(|source| source.key == key)
    }

    /// One RGB coefficient per column: `radiance = T · coefficients`.
    pub fn project(&self, rig: &LightRig) -> Vec<[f32; 3]> {
        let mut coefficients = vec![[0.0; 3]; self.n_cols()];
        for source in &self.sources {
            let columns = &mut coefficients[source.columns.start as usize..source.columns.end as usize];
            let setting = rig.light_setting(&source.key);
            match (source.kind, self.spots_of(rig, &source.key)) {
                (SourceKind::Dome { divisions }, _) => self.project_dome(rig, divisions, columns),
                (SourceKind::Sun { .. }, _) => columns.fill(self.project_sun(rig, setting, source).to_array()),
                (SourceKind::Panel { resolution, size_m }, Some(spots)) => {
                    project_spots(source, setting, resolution, size_m, spots, columns);
                }
                _ => columns.fill(setting.emission(source.color, source.strength).to_array()),
            }
        }
        coefficients
    }

    /// The lighting that the file is opened with: lights that are off there are muted. A look that says nothing about a light
    /// leaves it on.
    pub fn file_rig(&self) -> LightRig {
        let muted = LightSetting { muted: true, ..LightSetting::default() };
        let known = self.muted.iter().filter(|key| self.source(key).is_some());
        LightRig { lights: known.map(|key| (key.clone(), muted)).collect(), ..LightRig::default() }
    }

    /// Spots of a panel under a rig: its own, else those of the file.
    pub fn spots_of<'a>(&'a self, rig: &'a LightRig, key: &str) -> Option<&'a Vec<PanelSpot>> {
        rig.panels.get(key).or_else(|| self.spots.get(key))
    }

    /// Luminance of each column's coefficient under the light of the file, with all that is off turned on. The column of the sky
    /// that the camera sees is 0: none of it is scattered, so that factors know nothing of it.
    pub(crate) fn file_light(&self, column_scale: &[f32]) -> Vec<f32> {
        let light = self.project(&LightRig::default());
        let mut light: Vec<f32> =
            light.iter().zip(column_scale).map(|(&rgb, scale)| luminance(Vec3::from(rgb)) / scale).collect();
        for source in self.sources.iter().filter(|source| matches!(source.kind, SourceKind::Dome { .. })) {
            light[source.columns.end as usize - 1] = 0.0;
        }
        light
    }

    /// How the columns of a group lie beside each other: texels of a panel on a grid, the others in no order.
    pub(crate) fn runs(&self, group: &ColumnGroup) -> Vec<ColumnRun> {
        let is_inside =
            |source: &&LightSource| group.columns.contains(&source.columns.start) && !source.columns.is_empty();
        let mut runs: Vec<ColumnRun> = Vec::new();
        for source in self.sources.iter().filter(is_inside) {
            let n_cols = source.columns.len() as u32;
            match (source.kind, runs.last_mut()) {
                (SourceKind::Panel { resolution, .. }, _) if resolution <= MOST_TEXELS => {
                    runs.push(ColumnRun::Grid { width: resolution, height: resolution });
                }
                (_, Some(ColumnRun::List(len))) => *len += n_cols,
                _ => runs.push(ColumnRun::List(n_cols)),
            }
        }
        if group.kind == ColumnKind::Patch {
            runs.push(ColumnRun::List(group.columns.len() as u32));
        }
        runs
    }

    /// Keys of a rig that change nothing in this basis.
    pub fn unheeded_keys<'a>(&self, rig: &'a LightRig) -> Vec<(&'a str, Unheeded)> {
        let lights = rig.lights.keys().filter(|key| self.source(key).is_none());
        let lights = lights.map(|key| (key.as_str(), Unheeded::Unknown));
        let panels = rig.panels.keys().filter_map(|key| match self.source(key) {
            None => Some((key.as_str(), Unheeded::Unknown)),
            Some(LightSource { kind: SourceKind::Panel { .. }, .. }) => None,
            Some(_) => Some((key.as_str(), Unheeded::NoPanel)),
        });
        let taken = rig.lamps.iter().filter(|lamp| self.source(&lamp.key).is_some());
        let taken = taken.map(|lamp| (lamp.key.as_str(), Unheeded::Taken));
        let is_light = |key: &&String| self.source(key).is_some() || rig.lamps.iter().any(|lamp| lamp.key == **key);
        let members = rig.groups.values().flat_map(|group| &group.lights).filter(|key| !is_light(key));
        let members = members.map(|key| (key.as_str(), Unheeded::Unknown));
        let mut unheeded: Vec<_> = lights.chain(panels).chain(taken).chain(members).collect();
        unheeded.sort();
        unheeded.dedup();
        unheeded
    }

    /// Coefficients split by group, as a relighter takes them.
    pub fn split_by_group(&self, coefficients: &[[f32; 3]]) -> Vec<Vec<[f32; 3]>> {
        self.groups.iter().map(|g| coefficients[g.columns.start as usize..g.columns.end as usize].to_vec()).collect()
    }
}

mod sky;
pub use sky::SunApart;
pub(crate) use sky::{DomeLight, MovedSun};

/// Samples per side of a texel that measure how much of it a spot covers.
const SPOT_SAMPLES: u32 = 4;

/// Adds the spots of a panel: each texel takes the mean of every spot's weight over its area.
fn project_spots(
    source: &LightSource,
    setting: LightSetting,
    resolution: u32,
    size_m: [f32; 2],
    spots: &[PanelSpot],
    columns: &mut [[f32; 3]],
) {
    let to_short_sides = Vec2::from(size_m) / size_m[0].min(size_m[1]);
    for spot in spots {
        let own = LightSetting { color: spot.color.or(setting.color), ..setting };
        let own = if spot.color.is_some() { LightSetting { kelvin: None, ..own } } else { own };
        let emission = own.emission(source.color, source.strength) * spot.intensity;
        for (texel_idx, column) in columns.iter_mut().enumerate() {
            let texel = Vec2::new((texel_idx as u32 % resolution) as f32, (texel_idx as u32 / resolution) as f32);
            let mut weight = 0.0;
            for sample in 0..SPOT_SAMPLES * SPOT_SAMPLES {
                let within = Vec2::new((sample % SPOT_SAMPLES) as f32, (sample / SPOT_SAMPLES) as f32) + 0.5;
                let uv = (texel + within / SPOT_SAMPLES as f32) / resolution as f32;
                weight += spot.weight((uv - Vec2::from(spot.position)) * to_short_sides);
            }
            weight /= (SPOT_SAMPLES * SPOT_SAMPLES) as f32;
            *column = (Vec3::from(*column) + emission * weight).to_array();
        }
    }
}

/// Gives each light a key of its own: names as they are, repeats `#2`, `#3`, unnamed ones `node:INDEX`.
#[derive(Default)]
pub struct KeyMaker {
    taken: HashSet<String>,
    /// Number of the last repeat of a name: those up to it are taken.
    repeats: HashMap<String, u32>,
}

impl KeyMaker {
    /// The key of the next light.
    pub fn key(&mut self, name: Option<&str>, node_index: u32) -> String {
        let base = name.filter(|n| !n.is_empty()).map_or_else(|| format!("node:{node_index}"), str::to_string);
        if self.taken.insert(base.clone()) {
            return base;
        }
        let repeat = self.repeats.entry(base.clone()).or_insert(1);
        loop {
            *repeat += 1;
            let key = format!("{base}#{repeat}");
            if self.taken.insert(key.clone()) {
                return key;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn source(key: &str, kind: SourceKind, n: u32) -> LightSource {
        LightSource {
            key: key.into(),
            kind,
            columns: 0..n,
            color: Vec3::new(1.0, 0.5, 0.25),
            strength: 8.0,
            origin: LightOrigin::default(),
        }
    }

    fn panel(resolution: u32) -> SourceKind {
        SourceKind::Panel { resolution, size_m: [2.0, 1.0] }
    }

    #[test]
    fn luminaires_share_a_group_and_each_panel_has_its_own() {
        let basis = LightBasis::new(vec![
            source("p", panel(4), 16),
            source("a", SourceKind::Point, 1),
            source("q", panel(4), 16),
            source("b", SourceKind::Emitter, 1),
        ]);
        let columns: Vec<_> = basis.groups.iter().map(|g| g.columns.clone()).collect();
        assert_eq!(columns, [0..2, 2..18, 18..34]);
        assert_eq!(basis.sources[0].key, "a");
    }

    #[test]
    fn lights_are_the_same_in_another_order_unless_one_of_them_is_not() {
        let of = |lights: [(&str, SourceKind, u32); 3]| {
            LightBasis::new(lights.map(|(key, kind, n)| source(key, kind, n)).to_vec()).sources
        };
        let [a, b, c] = [("a", SourceKind::Point, 1), ("b", SourceKind::Spot, 1), ("c", SourceKind::Emitter, 1)];
        let (own, turned) = (of([a, b, c]), of([b, c, a]));
        assert!(!LightSource::are_alike(&own, &turned) && LightSource::are_alike_in_any_order(&own, &turned));
        let mut stronger = turned.clone();
        stronger[2].strength *= 2.0;
        let renamed = of([b, c, ("d", SourceKind::Point, 1)]);
        let wider = of([b, c, ("a", SourceKind::Point, 2)]);
        for other in [&stronger[..], &renamed[..], &turned[1..], &wider[..]] {
            assert!(!LightSource::are_alike_in_any_order(&own, other), "{other:?}");
        }
    }

    #[test]
    fn a_rig_without_entries_is_the_file_and_an_empty_panel_is_dark() {
        let basis = LightBasis::new(vec![source("p", panel(4), 16), source("a", SourceKind::Point, 1)]);
        assert!(basis.project(&LightRig::default()).iter().all(|c| *c == [8.0, 4.0, 2.0]));
        let mut rig = LightRig::default();
        rig.panels.insert("p".into(), vec![]);
        assert!(basis.project(&rig)[1..].iter().all(|c| *c == [0.0; 3]));
    }

    #[test]
    fn what_changes_nothing_is_told_with_its_reason() {
        let kinds = [("lamp", SourceKind::Point, 1), ("p", panel(4), 16)];
        let basis = LightBasis::new(kinds.into_iter().map(|(key, kind, n)| source(key, kind, n)).collect());
        let mut rig = LightRig::default();
        let muted = LightSetting { muted: true, ..LightSetting::default() };
        rig.lights.extend(["lamp", "none", "p"].map(|key| (key.to_owned(), muted)));
        rig.panels.extend(["lamp", "none", "nothing", "p"].map(|key| (key.to_owned(), vec![])));
        let expected = [("lamp", Unheeded::NoPanel), ("none", Unheeded::Unknown), ("nothing", Unheeded::Unknown)];
        assert_eq!(basis.unheeded_keys(&rig), expected);
    }

    #[test]
    fn a_wide_spot_is_the_uniform_panel_and_spots_add() {
        let basis = LightBasis::new(vec![source("p", panel(8), 64)]);
        let wide = PanelSpot { position: [0.5, 0.5], radius: 100.0, color: None, intensity: 1.0 };
        let mut rig = LightRig::default();
        rig.panels.insert("p".into(), vec![wide, PanelSpot { intensity: 0.5, color: Some([1.0; 3]), ..wide }]);
        for c in basis.project(&rig) {
            assert!((Vec3::from(c) - Vec3::new(12.0, 8.0, 6.0)).abs().max_element() < 1e-4, "{c:?}");
        }
    }

    #[test]
    fn repeated_names_count_and_collisions_stay_unique() {
        let mut keys = KeyMaker::default();
        let got =
            [keys.key(Some("lamp"), 0), keys.key(Some("lamp"), 1), keys.key(None, 7), keys.key(Some("lamp#2"), 8)];
        assert_eq!(got, ["lamp", "lamp#2", "node:7", "lamp#2#2"]);
        let later = [keys.key(Some("lamp#4"), 9), keys.key(Some("lamp"), 10), keys.key(Some("lamp"), 11)];
        assert_eq!(later, ["lamp#4", "lamp#3", "lamp#5"]);
    }
}
