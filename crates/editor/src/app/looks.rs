//! Looks in the window: their pictures, made when they or the bake change, and what is asked for about them.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Result;
use clerestory_transport::basis::LightBasis;
use clerestory_transport::light::LightRig;
use eframe::egui::{self, Context, Panel, TextureHandle, TextureId, TextureOptions, Ui, Vec2};

use super::App;
use super::follow::is_as_large;
use crate::export::ExportOptions;
use crate::export::layers::LayerSet;
use crate::legend::Legend;
use crate::look::{Display, Look};
use crate::output::spare_inputs;
use crate::panels::lights::heard;
use crate::panels::looks::mix::{Compare, Side};
use crate::panels::looks::timeline::toggle;
use crate::panels::looks::{LooksView, in_row, looks_ui};
use crate::panels::sight::keep_in_sight;
use crate::sequence::{Pattern, Sequence};
use crate::session::lamps::LampLight;
use crate::session::prints::{Lit, PrintOrder, Printer, Slot};
use crate::session::{Session, Shown, Wake};
use crate::stills::{Size, Subject};
use crate::viewport::compare::Compared;
use crate::words::in_words;

/// Width of a thumbnail in pixels: as wide as a card at twice the usual scale.
const THUMBNAIL_PX: u32 = 232;
/// Part of the height between the bars that the strip may take.
const MOST_HEIGHT: f32 = 0.6;

/// Keeps the pictures of looks in step with them.
pub(super) struct Prints {
    printer: Printer,
    /// What is pictured, and which whole picture of the session it is.
    subject: Option<(u64, Arc<Subject>)>,
    /// What each picture was ordered of.
    ordered: BTreeMap<Slot, Look>,
    textures: BTreeMap<Slot, TextureHandle>,
    /// What the sides of a comparison show, as they are pictured.
    lit: BTreeMap<Slot, Lit>,
    n_made: u64,
}

impl Prints {
    pub fn new(wake: Wake) -> Result<Prints> {
        let (ordered, textures, lit) = (BTreeMap::new(), BTreeMap::new(), BTreeMap::new());
        Ok(Prints { printer: Printer::start(wake)?, subject: None, ordered, textures, lit, n_made: 0 })
    }

    /// No picture of the last scene is left.
    pub fn forget(&mut self) {
        self.subject = None;
        self.ordered.clear();
        self.textures.clear();
        self.lit.clear();
    }

    /// Whether every picture that was asked for is there.
    pub fn is_idle(&self) -> bool {
        self.printer.is_idle()
    }

    /// The picture of a slot, and its size in pixels.
    pub fn picture(&self, slot: &Slot) -> Option<(TextureId, Vec2)> {
        self.textures.get(slot).map(|texture| (texture.id(), texture.size_vec2()))
    }

    /// What the side of a comparison is lit by, and the light of its free lamps, if they were lit for the bake that is shown.
    pub fn light(&self, slot: &Slot, shown: &Shown) -> Option<(&LightRig, Option<&LampLight>)> {
        let lit = self.lit.get(slot)?;
        let is_of_it = lit.lamps.as_ref().is_none_or(|light| is_as_large(light, shown));
        is_of_it.then_some((&lit.rig, lit.lamps.as_ref()))
    }

    /// What the colors of the side of a comparison mean, where they are false.
    pub fn legend(&self, slot: &Slot) -> Option<Legend> {
        self.lit.get(slot)?.legend
    }

    /// Number of pictures that were made since the window opened.
    pub fn n_made(&self) -> u64 {
        self.n_made
    }

    /// Takes in what was made, and orders what is new; what is compared is seen under a solo. Fails with words for people.
    pub fn follow(
        &mut self,
        ctx: &Context,
        session: &Session,
        look: &Look,
        compare: Option<&Compare>,
        solo: &BTreeSet<String>,
    ) -> Result<(), String> {
        let mut problem = Ok(());
        for print in self.printer.take() {
            match print.printed {
                // What is no longer wanted came too late.
                Ok((image, lit)) if self.ordered.contains_key(&print.slot) => {
                    let texture = ctx.load_texture(format!("{:?}", print.slot), image, TextureOptions::LINEAR);
                    self.lit.extend(lit.map(|lit| (print.slot.clone(), lit)));
                    self.textures.insert(print.slot, texture);
                    self.n_made += 1;
                }
                Ok(_) => {}
                Err(words) => problem = Err(words),
            }
        }
        let snapshots = look.snapshots.iter();
        let thumbnails = snapshots.map(|s| (Slot::Thumbnail(s.name.clone()), (Cow::Borrowed(&s.lights), s.display)));
        let sides = compare.iter().flat_map(|compare| compare.sides.iter().enumerate());
        let sides = sides.filter_map(|(idx, side)| match side {
            Side::Snapshot(name) => {
                let snapshot = look.snapshot(name)?;
                Some((Slot::Side(idx), (under_solo(session.basis(), &snapshot.lights, solo), snapshot.display)))
            }
            Side::Present => None,
        });
        self.order(session, thumbnails.chain(sides).collect());
        problem
    }

    /// Most looks stay as they are from frame to frame, and are compared without a copy.
    fn order(&mut self, session: &Session, wanted: BTreeMap<Slot, (Cow<LightRig>, Display)>) {
        self.ordered.retain(|slot, _| wanted.contains_key(slot));
        self.textures.retain(|slot, _| wanted.contains_key(slot));
        self.lit.retain(|slot, _| wanted.contains_key(slot));
        if wanted.is_empty() || !session.is_whole() {
            self.subject = None;
            return;
        }
        let is_new = self.subject.as_ref().is_none_or(|(n_whole, _)| *n_whole != session.n_whole);
        if is_new {
            self.subject = session.subject().map(|subject| (session.n_whole, Arc::new(subject)));
            self.ordered.clear();
        }
        let Some((_, subject)) = &self.subject else { return };
        for (slot, (lights, display)) in wanted {
            let is_it = |ordered: &Look| (&ordered.lights, &ordered.display) == (&*lights, &display);
            if self.ordered.get(&slot).is_some_and(is_it) {
                continue;
            }
            let look = Look { lights: lights.into_owned(), display, ..Look::default() };
            let size = match slot {
                Slot::Thumbnail(_) => Size::Within(THUMBNAIL_PX),
                Slot::Side(_) => Size::Whole,
            };
            self.printer.order(slot.clone(), PrintOrder { subject: subject.clone(), look: look.clone(), size });
            self.ordered.insert(slot, look);
        }
    }
}

/// The lights as they are seen under a solo.
fn under_solo<'a>(basis: Option<&LightBasis>, rig: &'a LightRig, solo: &BTreeSet<String>) -> Cow<'a, LightRig> {
    match basis {
        Some(basis) if !solo.is_empty() => Cow::Owned(heard(basis, rig, solo)),
        _ => Cow::Borrowed(rig),
    }
}

impl App {
    /// The strip of looks below the picture.
    pub(super) fn looks_ui(&mut self, ui: &mut Ui) {
        let frame = egui::Frame::side_top_panel(ui.style()).inner_margin(egui::Margin::symmetric(12, 5));
        let most = MOST_HEIGHT * ui.available_height();
        Panel::bottom("looks").frame(frame).show(ui, |ui| {
            let prints = &self.prints;
            let thumbnail = |name: &str| prints.picture(&Slot::Thumbnail(name.to_owned()));
            let view = LooksView {
                basis: self.session.basis(),
                thumbnail: &thumbnail,
                frames: self.session.frames(),
                can_export: self.session.shown.is_some(),
                is_scene: self.session.has_scene(),
            };
            let area = egui::ScrollArea::vertical().id_salt("strip").max_height(most).min_scrolled_height(most);
            area.auto_shrink([false, true]).show(ui, |ui| {
                looks_ui(ui, &mut self.look, &mut self.looks, &view, &mut self.actions);
                keep_in_sight(ui, "strip");
            });
        });
    }

    /// Lights the scene as a snapshot says.
    pub(super) fn take_look(&mut self, idx: usize) {
        if let Some(name) = self.look.snapshots.get(idx).map(|snapshot| snapshot.name.clone()) {
            self.looks.player.stop();
            self.daylight.stop();
            self.let_go();
            self.as_one_step(|app| app.look.take(idx));
            self.say(format!("The look “{name}” is on"));
        }
    }

    pub(super) fn play_timeline(&mut self) {
        if !self.look.timeline.keys.is_empty() {
            self.looks.timeline = true;
            toggle(&mut self.looks.player, &self.look.timeline);
        }
    }

    /// Lets the timeline run on.
    pub(super) fn advance_timeline(&mut self, ctx: &Context) {
        let player = &mut self.looks.player;
        let was_playing = player.playing;
        player.advance(&self.look.timeline, ctx.input(|input| input.stable_dt));
        if was_playing {
            ctx.request_repaint();
        }
    }

    /// What is shown: a moment of the timeline while it plays or is looked at, else the present look.
    pub(super) fn seen(&self) -> Look {
        let moment = self.looks.player.playhead.map(|secs| self.look.at(secs, self.session.basis()));
        moment.unwrap_or_else(|| self.solving.previewed(&self.look).present())
    }

    /// Has the picture follow what is to be seen.
    pub(super) fn follow(&mut self, ctx: &Context) {
        let mut seen = self.seen();
        if self.hides_false_color() {
            seen.display.false_color = None;
        }
        if let Err(words) = self.follower.follow(ctx, &mut self.session, &seen, &self.lights.solo) {
            self.complain(words);
        } else if self.follower.take_return() {
            self.say("The graphics device relights again");
        }
    }

    /// The side on which what is dragged can be seen: that of the lights as they are now, 0 where nothing is compared; none while a
    /// moment of the timeline is looked at, or both sides are looks that were kept.
    pub(super) fn handled_side(&self, compared: Option<&Compared>) -> Option<usize> {
        let compare = self.looks.compare.as_ref().filter(|_| compared.is_some());
        let side = compare.map_or(Some(0), |compare| compare.sides.iter().position(|side| *side == Side::Present));
        side.filter(|_| self.looks.player.playhead.is_none())
    }

    /// The picture on the left of a comparison and what it is compared with, once both pictures are there.
    pub(super) fn compared(&self) -> Option<(TextureId, Compared)> {
        let (compare, (present, _)) = (self.looks.compare.as_ref()?, self.follower.picture()?);
        let texture = |idx: usize| match &compare.sides[idx] {
            Side::Present => Some(present),
            Side::Snapshot(_) => self.prints.picture(&Slot::Side(idx)).map(|(texture, _)| texture),
        };
        let (left, right) = (texture(0)?, texture(1)?);
        let names = [0, 1].map(|idx| match (&compare.sides[idx], self.looks.player.playhead) {
            (Side::Present, Some(secs)) => format!("{secs:.2} s"),
            (side, _) => in_row(&side.words()),
        });
        Some((left, Compared { right, names, way: compare.way }))
    }

    /// Writes the scene with its lights as they are seen, a solo included.
    pub(super) fn export_gltf(&mut self, path: PathBuf) {
        let seen = self.seen_look();
        let opened = self.session.opened.as_ref().and_then(|opened| opened.path.clone());
        let spared = spare_inputs(&path, opened.iter().map(|scene| ("opened scene", scene.as_path())));
        match spared {
            Ok(()) if self.is_scene_rewritten() => {
                self.complain(
                    "the scene was written anew since it was opened; reload it, and then save it with its lights",
                );
            }
            Ok(()) => self.session.export_gltf(seen, path),
            Err(error) => self.complain(in_words(&error)),
        }
    }

    /// Writes the pictures of all snapshots on one sheet.
    pub(super) fn save_sheet(&mut self, path: PathBuf) {
        if self.lacks_whole_picture() {
            return;
        }
        let opened = self.session.opened.as_ref().and_then(|opened| opened.path.clone());
        let inputs = [("look", self.look_path.as_ref()), ("scene", opened.as_ref())];
        let inputs = inputs.into_iter().filter_map(|(what, input)| Some((what, input?.as_path())));
        match spare_inputs(&path, inputs) {
            Ok(()) => {
                self.say_begun(format!("Writing {}", path.display()));
                self.session.save_sheet(self.look.snapshots.clone(), path);
            }
            Err(error) => self.complain(in_words(&error)),
        }
    }

    /// Writes the frames of the timeline.
    pub(super) fn export_frames(&mut self, path: &Path) {
        if self.lacks_whole_picture() {
            return;
        }
        let opened = self.session.opened.as_ref().and_then(|opened| opened.path.clone());
        let inputs = [("look", self.look_path.clone()), ("scene", opened)];
        let inputs: Vec<_> = inputs.into_iter().filter_map(|(what, path)| Some((what, path?))).collect();
        let read: Vec<(&'static str, &Path)> = inputs.iter().map(|(what, path)| (*what, path.as_path())).collect();
        let sequence = Pattern::new(path).and_then(|pattern| {
            let asked = self.asked_frames.map(|[first, last]| first..=last);
            let sequence = Sequence::new(self.heard_look(), pattern, asked, None)?;
            sequence.spare(&read)?;
            // Frames have no layers, and a light that arrives where it was baked alone.
            let options = ExportOptions { layers: LayerSet::None, irradiance: false, ..self.export };
            Ok(Sequence { options, ..sequence })
        });
        match sequence {
            Ok(sequence) => {
                self.say_begun(format!("Writing {} frames", sequence.n_frames()));
                self.session.export_frames(sequence);
            }
            Err(error) => self.complain(in_words(&error)),
        }
    }
}
