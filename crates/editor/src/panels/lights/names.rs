//! Names that a designer gives to lights and groups; keys stay.

use eframe::egui::{Key, Response, TextEdit, Ui, Vec2};

use super::listed::Listed;
use crate::look::Look;

/// A name that is being typed: the key of what it is for, and the text.
pub(in crate::panels) type Renaming = Option<(String, String)>;

/// Gives something another name; its own one, or none, takes the name away.
fn rename(look: &mut Look, key: &str, own_name: &str, name: &str) {
    let name = name.trim();
    if name.is_empty() || name == own_name {
        look.names.remove(key);
    } else {
        look.names.insert(key.to_owned(), name.to_owned());
    }
}

/// Whether another light is called so.
fn is_taken(lights: &[Listed], key: &str, name: &str) -> bool {
    lights.iter().any(|light| light.key != key && light.name == name.trim())
}

/// A field for the name of what `key` stands for. `lights` are those that must not be called the same.
pub(in crate::panels) fn name_field_ui(
    ui: &mut Ui,
    (key, own_name): (&str, &str),
    look: &mut Look,
    renaming: &mut Renaming,
    lights: &[Listed],
) -> Response {
    let now = look.names.get(key).map_or(own_name, String::as_str).to_owned();
    let mut name = renaming.take().filter(|(of, _)| of == key).map_or_else(|| now.clone(), |(_, typed)| typed);
    let edit = ui.add(TextEdit::singleline(&mut name).desired_width(f32::INFINITY));
    let edit = edit.accessible_name(format!("Name of {now}"));
    let is_free = !is_taken(lights, key, &name);
    if edit.has_focus() && !is_free {
        edit.show_tooltip_text("Another light has this name");
    }
    if edit.lost_focus() {
        let is_wanted = !ui.input(|input| input.key_pressed(Key::Escape));
        if is_wanted && is_free && name != now {
            rename(look, key, own_name, &name);
        }
    } else if edit.has_focus() {
        *renaming = Some((key.to_owned(), name));
    }
    edit
}

/// The field in place of a name that is asked for, as large as that; it takes the keyboard at once. Answers whether it is shown.
pub(super) fn renaming_ui(
    ui: &mut Ui,
    of: (&str, &str),
    size: Vec2,
    look: &mut Look,
    renaming: &mut Renaming,
    lights: &[Listed],
) -> bool {
    let Some(asked) = renaming.clone().filter(|(key, _)| key == of.0) else { return false };
    ui.allocate_ui(size, |ui| {
        ui.set_min_size(size);
        let edit = name_field_ui(ui, of, look, renaming, lights);
        if !edit.has_focus() && !edit.lost_focus() {
            *renaming = Some(asked);
            edit.request_focus();
        }
    });
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_stands_beside_its_key_until_it_is_taken_away() {
        let mut look = Look::default();
        rename(&mut look, "node:3", "node:3", " Desk ");
        assert_eq!((look.name_of("node:3"), look.name_of("node:4")), ("Desk", "node:4"));
        rename(&mut look, "node:3", "node:3", "node:3");
        assert_eq!(look, Look::default());
    }
}
