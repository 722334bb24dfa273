//! Spots of light in the picture: which panel is under the pointer, and where a spot goes when it is dragged.

use clerestory_transport::basis::{LightBasis, SourceKind};
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::emitters::PanelEmitter;
use clerestory_transport::light::PanelSpot;
use clerestory_transport::prepared::PreparedScene;
use eframe::egui::accesskit::Role;
use eframe::egui::{self, Color32, Id, Painter, Pos2, Rect, Shape, Stroke, Ui, vec2};
use glam::Vec2;

use super::lamps::tell;
use crate::look::Look;
use crate::panels::spots::{HANDLE_REACH, NEW_SPOT, nearest, taken_over};
use crate::theme;

/// What the pointer holds.
#[derive(Clone, Debug, PartialEq)]
pub enum Grab {
    /// The picture itself.
    Picture,
    /// A corner of the region to be shown, points.
    Region(Pos2),
    /// A spot of a panel.
    Spot(HeldSpot),
}

/// A spot that is dragged.
#[derive(Clone, Debug, PartialEq)]
pub struct HeldSpot {
    /// Key of its panel.
    pub panel: String,
    /// Which of the spots there.
    pub idx: usize,
    /// Where it is carried to, points: off the pointer by as much as it was taken there, or went finely.
    at: Pos2,
    /// Where the pointer was last.
    pointer: Pos2,
    /// The spots of the panel that the look had before, if any.
    before: Option<Vec<PanelSpot>>,
}

impl HeldSpot {
    /// The panel is again as it was.
    pub fn put_back(self, look: &mut Look) {
        match self.before {
            Some(spots) => look.lights.panels.insert(self.panel, spots),
            None => look.lights.panels.remove(&self.panel),
        };
    }
}

/// The panels of a scene as they are seen in the picture.
pub struct PanelPicker<'a> {
    /// The scene.
    pub scene: &'a PreparedScene,
    /// Where it is seen from.
    pub camera: &'a Camera,
    /// Size of the picture in pixels.
    pub film: Film,
    /// Where the picture is drawn, points.
    pub image: Rect,
    /// The lights that the picture is made of: a scene may have others by now.
    pub baked: Option<&'a LightBasis>,
}

/// How far from a spot is looked where a side of its panel leads, in sides of it.
const NEAR: f32 = 0.01;
/// Share of light that must come through what is in front of a panel for it to be seen.
const SEEN: f32 = 0.5;
/// Radius of a handle in points.
const HANDLE_RADIUS: f32 = 7.0;

impl PanelPicker<'_> {
    fn all_panels(&self) -> impl Iterator<Item = (&str, &PanelEmitter)> {
        let sources = &self.scene.lighting.basis.sources;
        self.scene.lighting.panels().map(|(idx, panel)| (sources[idx].key.as_str(), panel))
    }

    /// Those that can be set.
    fn panels(&self) -> impl Iterator<Item = (&str, &PanelEmitter)> {
        self.all_panels().filter(move |(key, _)| self.is_baked(key))
    }

    /// Whether the picture knows a panel; spots of another one would change nothing in it.
    fn is_baked(&self, key: &str) -> bool {
        let is_panel = |basis: &LightBasis| {
            basis.source(key).is_some_and(|source| matches!(source.kind, SourceKind::Panel { .. }))
        };
        self.baked.is_none_or(is_panel)
    }

    fn panel(&self, key: &str) -> Option<&PanelEmitter> {
        self.panels().find(|(k, _)| *k == key).map(|(_, panel)| panel)
    }

    fn ray(&self, at: Pos2) -> glam::Vec3 {
        let px = (at - self.image.min) / self.image.size() * vec2(self.film.width as f32, self.film.height as f32);
        self.camera.direction(self.film, Vec2::new(px.x, px.y))
    }

    /// Where a point of a panel is seen, in points; nothing behind the camera.
    fn seen_at(&self, panel: &PanelEmitter, uv: Vec2) -> Option<Pos2> {
        let px = self.camera.project(self.film, panel.point(uv))?;
        let scale = vec2(self.image.width() / self.film.width as f32, self.image.height() / self.film.height as f32);
        Some(self.image.min + vec2(px.x, px.y) * scale)
    }

    /// Whether the shining side is turned to the camera.
    fn faces(&self, panel: &PanelEmitter) -> bool {
        panel.double_sided || (self.camera.position() - panel.origin).dot(panel.normal) > 0.0
    }

    /// The panel under the pointer that can be set, and where on it.
    fn hit(&self, at: Pos2) -> Option<(&str, Vec2)> {
        self.seen_under(at).filter(|(key, _)| self.is_baked(key))
    }

    /// The panel under the pointer that nothing hides, and where on it.
    fn seen_under(&self, at: Pos2) -> Option<(&str, Vec2)> {
        if !self.image.contains(at) {
            return None;
        }
        let (origin, direction) = (self.camera.position(), self.ray(at));
        let hits = self.all_panels().filter_map(|(key, panel)| Some((key, panel, panel.intersect(origin, direction)?)));
        let (key, panel, (_, uv)) = hits.min_by(|a, b| a.2.0.total_cmp(&b.2.0))?;
        (self.scene.transmittance(origin, panel.point(uv)).max_element() > SEEN).then_some((key, uv))
    }

    /// Whether nothing hides a spot: its handle would lie on what does.
    fn sees(&self, panel: &PanelEmitter, spot: &PanelSpot) -> bool {
        let point = panel.point(spot.position.into());
        self.scene.transmittance(self.camera.position(), point).max_element() > SEEN
    }

    /// Point of a panel's plane under the pointer, held within the panel.
    fn on_plane(&self, panel: &PanelEmitter, at: Pos2) -> Option<[f32; 2]> {
        let (origin, direction) = (self.camera.position(), self.ray(at));
        let t = (panel.origin - origin).dot(panel.normal) / direction.dot(panel.normal);
        let uv = panel.uv_of(origin + direction * t).clamp(Vec2::ZERO, Vec2::ONE);
        (t.is_finite() && t > 0.0 && uv.is_finite()).then_some(uv.to_array())
    }

    /// Spots of a panel: those of the look, else those of its file.
    fn spots<'a>(&'a self, key: &str, look: &'a Look) -> &'a [PanelSpot] {
        self.scene.lighting.basis.spots_of(&look.lights, key).map_or(&[] as &[PanelSpot], Vec::as_slice)
    }

    /// Those of the look, which takes over what the file has.
    fn own_spots<'a>(&self, key: &str, look: &'a mut Look) -> &'a mut Vec<PanelSpot> {
        let marked = self.scene.lighting.basis.spots.get(key).map_or(&[] as &[PanelSpot], Vec::as_slice);
        look.lights.panels.entry(key.to_owned()).or_insert_with(|| taken_over(marked))
    }

    /// The handle within reach of the pointer.
    fn handle(&self, at: Pos2, look: &Look) -> Option<(&str, usize)> {
        let handles = self.panels().filter(|(_, panel)| self.faces(panel)).flat_map(|(key, panel)| {
            self.spots(key, look).iter().enumerate().filter_map(move |(idx, spot)| {
                let seen = self.seen_at(panel, spot.position.into()).filter(|_| self.sees(panel, spot))?;
                Some((key, idx, seen.distance(at)))
            })
        });
        let (key, idx, distance) = handles.min_by(|a, b| a.2.total_cmp(&b.2))?;
        (distance < HANDLE_REACH).then_some((key, idx))
    }

    /// What a press takes hold of. On a panel without spots it makes the first one.
    pub fn grab(&self, at: Pos2, look: &mut Look) -> Option<HeldSpot> {
        if let Some((key, idx)) = self.handle(at, look) {
            let before = look.lights.panels.get(key).cloned();
            let spot = self.own_spots(key, look).get(idx).copied()?;
            // It stays under the pointer as it was taken: off its middle by as much.
            let middle = self.panel(key).and_then(|panel| self.seen_at(panel, spot.position.into()));
            return Some(HeldSpot { panel: key.to_owned(), idx, at: middle.unwrap_or(at), pointer: at, before });
        }
        let (key, uv) = self.hit(at)?;
        let before = look.lights.panels.get(key).cloned();
        let spots = self.own_spots(key, look);
        if spots.is_empty() {
            spots.push(PanelSpot { position: uv.to_array(), ..NEW_SPOT });
        }
        let idx = nearest(spots.iter().map(|spot| Vec2::from(spot.position).distance(uv)))?;
        Some(HeldSpot { panel: key.to_owned(), idx, at, pointer: at, before })
    }

    /// Moves a spot on to where the pointer is now, by a part of the way.
    pub fn drag(&self, held: &mut HeldSpot, pointer: Pos2, part: f32, look: &mut Look) {
        held.at += (pointer - held.pointer) * part;
        held.pointer = pointer;
        let to = self.panel(&held.panel).and_then(|panel| self.on_plane(panel, held.at));
        let spot = look.lights.panels.get_mut(&held.panel).and_then(|spots| spots.get_mut(held.idx));
        if let (Some(to), Some(spot)) = (to, spot) {
            spot.position = to;
        }
    }

    /// Moves a spot along that side of its panel which is seen to lead where arrow keys ask for; `step` in sides of a panel of so many texels.
    pub fn nudge(&self, panel: &str, idx: usize, arrows: egui::Vec2, step: impl Fn(u32) -> f32, look: &mut Look) {
        let spot = look.lights.panels.get_mut(panel).and_then(|spots| spots.get_mut(idx));
        let (Some(panel), Some(spot)) = (self.panel(panel), spot) else { return };
        let from = Vec2::from(spot.position);
        let Some(at) = self.seen_at(panel, from) else { return };
        let along = |side: Vec2| {
            let there = self.seen_at(panel, from + side * NEAR);
            there.map_or(f32::NEG_INFINITY, |there| (there - at).normalized().dot(arrows))
        };
        let sides = [Vec2::X, Vec2::NEG_X, Vec2::Y, Vec2::NEG_Y];
        if let Some(side) = sides.into_iter().max_by(|a, b| along(*a).total_cmp(&along(*b))) {
            let to = from + side * arrows.length() * step(panel.resolution);
            spot.position = to.clamp(Vec2::ZERO, Vec2::ONE).to_array();
        }
    }

    /// Adds a spot where the pointer is on a panel; answers which.
    pub fn add(&self, at: Pos2, look: &mut Look) -> Option<(String, usize)> {
        let (key, uv) = self.hit(at)?;
        let spots = self.own_spots(key, look);
        let like = spots.last().copied().unwrap_or(NEW_SPOT);
        spots.push(PanelSpot { position: uv.to_array(), ..like });
        Some((key.to_string(), spots.len() - 1))
    }

    /// What the menu of the picture offers for a place on a panel.
    pub fn menu_ui(&self, ui: &mut Ui, at: Pos2, look: &mut Look, chosen: &mut Option<(String, usize)>) {
        if let Some((key, idx)) = self.handle(at, look)
            && ui.button("Delete this spot").clicked()
        {
            self.own_spots(key, look).remove(idx);
            // Another one that is chosen stays so, wherever it stands now.
            *chosen = chosen.take().filter(|(panel, nth)| panel != key || *nth != idx);
            if let Some((_, nth)) = chosen.as_mut().filter(|(panel, nth)| panel == key && *nth > idx) {
                *nth -= 1;
            }
            ui.close();
        }
        if self.hit(at).is_some() && ui.button("Add a spot here").clicked() {
            *chosen = self.add(at, look);
            ui.close();
        }
    }

    /// What can be done where the pointer is.
    pub fn hint(&self, at: Pos2, look: &Look) -> Option<String> {
        if let Some((key, idx)) = self.handle(at, look) {
            return Some(format!("{}, spot {}, drag to move it", look.name_of(key), idx + 1));
        }
        let (key, _) = self.seen_under(at)?;
        let what = if !self.is_baked(key) {
            "it is not in this bake"
        } else if !self.spots(key, look).is_empty() {
            "drag to move the nearest spot, double-click to add one"
        } else {
            "drag to place a spot of light"
        };
        Some(format!("{}, {what}", look.name_of(key)))
    }

    /// Draws a handle for each spot, and the outline of the chosen one on its panel.
    pub fn paint(&self, painter: &Painter, look: &Look, chosen: Option<&(String, usize)>) {
        for (key, panel) in self.panels().filter(|(_, panel)| self.faces(panel)) {
            for (idx, spot) in self.spots(key, look).iter().enumerate() {
                let is_chosen = chosen.is_some_and(|(k, i)| k == key && *i == idx);
                let Some(center) = self.seen_at(panel, spot.position.into()) else { continue };
                if !self.sees(panel, spot) {
                    continue;
                }
                let color = if is_chosen { theme::ACCENT } else { Color32::from_gray(235) };
                if is_chosen {
                    painter.add(Shape::closed_line(
                        self.outline(panel, spot),
                        Stroke::new(1.2, color.gamma_multiply(0.7)),
                    ));
                }
                painter.circle_stroke(center, HANDLE_RADIUS, Stroke::new(4.0, Color32::from_black_alpha(130)));
                painter.circle_stroke(center, HANDLE_RADIUS, Stroke::new(2.0, color));
                painter.circle_filled(center, 2.0, color);
                let [u, v] = spot.position.map(|at| 100.0 * at);
                let words = format!("{}, spot {} at {u:.0} %, {v:.0} %", look.name_of(key), idx + 1);
                let place = Rect::from_center_size(center, vec2(2.0, 2.0) * HANDLE_RADIUS);
                if painter.clip_rect().contains(center) {
                    tell(painter.ctx(), Id::unique(("spot in the picture", key, idx)), (Role::Mark, &words), place);
                }
            }
        }
    }

    /// The rim of a spot as it is seen; empty where part of it lies behind the camera.
    fn outline(&self, panel: &PanelEmitter, spot: &PanelSpot) -> Vec<Pos2> {
        let sides = Vec2::new(panel.u_edge.length(), panel.v_edge.length());
        let radius = Vec2::splat(spot.radius * sides.min_element()) / sides;
        let rim = (0..48).map(|i| Vec2::from_angle(i as f32 / 48.0 * std::f32::consts::TAU));
        let seen = rim.map(|at| self.seen_at(panel, Vec2::from(spot.position) + at * radius));
        seen.collect::<Option<Vec<Pos2>>>().unwrap_or_default()
    }
}
