//! Looks in the window: their pictures, made when they or the bake change, and what is asked for about them.

use std::collections::BTreeMap;
use std::sync::Arc;

use anyhow::Result;
use eframe::egui::{self, Context, Panel, TextureHandle, TextureId, TextureOptions, Ui, Vec2};

use super::App;
use crate::look::Look;
use crate::panels::looks::{LooksView, looks_ui};
use crate::session::prints::{PrintOrder, Printer, Slot};
use crate::session::{Session, Wake};
use crate::stills::{Size, Subject};

/// Width of a thumbnail in pixels: as wide as a card at twice the usual scale.
const THUMBNAIL_PX: u32 = 232;

/// Keeps the pictures of looks in step with them.
pub(super) struct Prints {
    printer: Printer,
    /// What is pictured, and which whole picture of the session it is.
    subject: Option<(u64, Arc<Subject>)>,
    /// What each picture was ordered of.
    ordered: BTreeMap<Slot, Look>,
    textures: BTreeMap<Slot, TextureHandle>,
}

impl Prints {
    pub fn new(wake: Wake) -> Result<Prints> {
        let (ordered, textures) = (BTreeMap::new(), BTreeMap::new());
        Ok(Prints { printer: Printer::start(wake)?, subject: None, ordered, textures })
    }

    /// No picture of the last scene is left.
    pub fn forget(&mut self) {
        self.subject = None;
        self.ordered.clear();
        self.textures.clear();
    }

    /// Whether every picture that was asked for is there.
    pub fn is_idle(&self) -> bool {
        self.printer.is_idle()
    }

    /// The picture of a slot, and its size in pixels.
    pub fn picture(&self, slot: &Slot) -> Option<(TextureId, Vec2)> {
        self.textures.get(slot).map(|texture| (texture.id(), texture.size_vec2()))
    }

    /// Takes in what was made, and orders what is new. Fails with words for people.
    pub fn follow(&mut self, ctx: &Context, session: &Session, look: &Look) -> Result<(), String> {
        let mut problem = Ok(());
        for print in self.printer.take() {
            match print.image {
                // What is no longer wanted came too late.
                Ok(image) if self.ordered.contains_key(&print.slot) => {
                    let texture = ctx.load_texture(format!("{:?}", print.slot), image, TextureOptions::LINEAR);
                    self.textures.insert(print.slot, texture);
                }
                Ok(_) => {}
                Err(words) => problem = Err(words),
            }
        }
        let wanted = look.snapshots.iter().map(|s| (Slot::Thumbnail(s.name.clone()), s.look())).collect();
        self.order(session, wanted);
        problem
    }

    fn order(&mut self, session: &Session, wanted: BTreeMap<Slot, Look>) {
        self.ordered.retain(|slot, _| wanted.contains_key(slot));
        self.textures.retain(|slot, _| wanted.contains_key(slot));
        if wanted.is_empty() || session.n_whole == 0 {
            self.subject = None;
            return;
        }
        let is_new = self.subject.as_ref().is_none_or(|(n_whole, _)| *n_whole != session.n_whole);
        if is_new {
            self.subject = session.subject().map(|subject| (session.n_whole, Arc::new(subject)));
            self.ordered.clear();
        }
        let Some((_, subject)) = &self.subject else { return };
        for (slot, look) in wanted {
            if self.ordered.get(&slot) == Some(&look) {
                continue;
            }
            let size = match slot {
                Slot::Thumbnail(_) => Size::Within(THUMBNAIL_PX),
                Slot::Side(_) => Size::Whole,
            };
            self.printer.order(slot.clone(), PrintOrder { subject: subject.clone(), look: look.clone(), size });
            self.ordered.insert(slot, look);
        }
    }
}

impl App {
    /// The strip of looks below the picture.
    pub(super) fn looks_ui(&mut self, ui: &mut Ui) {
        let frame = egui::Frame::side_top_panel(ui.style()).inner_margin(egui::Margin::symmetric(12, 5));
        Panel::bottom("looks").frame(frame).show(ui, |ui| {
            let prints = &self.prints;
            let thumbnail = |name: &str| prints.picture(&Slot::Thumbnail(name.to_owned()));
            let view = LooksView { basis: self.session.basis(), thumbnail: &thumbnail };
            looks_ui(ui, &mut self.look, &mut self.looks, &view);
        });
    }

    /// Lights the scene as a snapshot says.
    pub(super) fn take_look(&mut self, idx: usize) {
        if let Some(name) = self.look.snapshots.get(idx).map(|snapshot| snapshot.name.clone()) {
            self.as_one_step(|app| app.look.take(idx));
            self.say(format!("Look {name}"));
        }
    }
}
