//! Which rows are selected: by a click, with the command key one more, with Shift all up to there.

use std::collections::BTreeSet;

use eframe::egui::Modifiers;

/// Keys of the selected lights.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Selection {
    keys: BTreeSet<String>,
    /// Where a selection with Shift begins, and which light was touched last.
    anchor: Option<String>,
    last: Option<String>,
}

impl Selection {
    /// Whether a light is selected.
    pub fn has(&self, key: &str) -> bool {
        self.keys.contains(key)
    }

    /// Whether nothing is.
    pub fn is_empty(&self) -> bool {
        self.keys.is_empty()
    }

    /// The light that alone is selected.
    pub fn single(&self) -> Option<&str> {
        self.keys.first().filter(|_| self.keys.len() == 1).map(String::as_str)
    }

    /// Selects one light alone.
    pub fn set(&mut self, key: &str) {
        self.set_all([key.to_owned()]);
    }

    /// Selects some lights and no others.
    pub fn set_all(&mut self, keys: impl IntoIterator<Item = String>) {
        self.keys = keys.into_iter().collect();
        self.anchor = self.keys.first().cloned();
        self.last.clone_from(&self.anchor);
    }

    /// Selects one more light.
    pub fn add(&mut self, key: &str) {
        self.keys.insert(key.to_owned());
        self.anchor = Some(key.to_owned());
        self.last.clone_from(&self.anchor);
    }

    /// Selects nothing.
    pub fn clear(&mut self) {
        *self = Selection::default();
    }

    /// A click on a row; a second one on the only row that is selected lets it go. `order` are the keys as they are shown.
    pub fn click(&mut self, key: &str, modifiers: Modifiers, order: &[String]) {
        let at = |wanted: &str| order.iter().position(|key| key == wanted);
        let range = modifiers.shift.then(|| at(self.anchor.as_deref()?).zip(at(key))).flatten();
        if let Some((from, to)) = range {
            self.keys = order[from.min(to)..=from.max(to)].iter().cloned().collect();
            self.last = Some(key.to_owned());
        } else if modifiers.command {
            if !self.keys.remove(key) {
                self.keys.insert(key.to_owned());
            }
            self.anchor = Some(key.to_owned());
            self.last.clone_from(&self.anchor);
        } else if self.keys.len() == 1 && self.has(key) {
            self.clear();
        } else {
            self.set(key);
        }
    }

    /// Goes so many rows down from a light, or from the one that was touched last: what is there is selected, with Shift all up to
    /// there. Answers which light that is, none where `order` does not show where it begins.
    pub fn step(&mut self, from: Option<&str>, by: isize, modifiers: Modifiers, order: &[String]) -> Option<String> {
        let from = from.or(self.last.as_deref())?;
        let from = order.iter().position(|key| key == from)?;
        let to = order[from.saturating_add_signed(by).min(order.len() - 1)].clone();
        if modifiers.shift {
            if self.anchor.is_none() {
                self.anchor = Some(order[from].clone());
            }
            self.click(&to, Modifiers::SHIFT, order);
        } else {
            self.set(&to);
        }
        Some(to)
    }

    /// A click on the row of a group.
    pub fn click_group(&mut self, keys: &[String], modifiers: Modifiers) {
        let is_all = keys.iter().all(|key| self.has(key));
        if modifiers.command || modifiers.shift {
            for key in keys {
                if is_all {
                    self.keys.remove(key)
                } else {
                    self.keys.insert(key.clone())
                };
            }
        } else if is_all && self.keys.len() == keys.len() {
            self.clear();
        } else {
            self.set_all(keys.iter().cloned());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_go_on_from_what_was_touched_last_and_stay_within_the_list() {
        let order = ["a", "b", "c"].map(str::to_owned);
        let mut selection = Selection::default();
        assert_eq!(selection.step(None, 1, Modifiers::NONE, &order), None, "nothing was touched");
        let mut step = |from, by, modifiers| {
            let to = selection.step(from, by, modifiers, &order).unwrap();
            (to, selection.keys.iter().cloned().collect::<String>())
        };
        let at = |to: &str, selected: &str| (to.to_owned(), selected.to_owned());
        assert_eq!(step(Some("a"), 1, Modifiers::NONE), at("b", "b"));
        assert_eq!(step(None, 1, Modifiers::SHIFT), at("c", "bc"));
        assert_eq!(step(None, 1, Modifiers::NONE), at("c", "c"));
        assert_eq!(step(None, -1, Modifiers::SHIFT), at("b", "bc"));
        assert_eq!(step(None, -1, Modifiers::SHIFT), at("a", "abc"));
        assert_eq!(step(None, -1, Modifiers::NONE), at("a", "a"));
        assert_eq!(selection.step(Some("hidden"), 1, Modifiers::NONE, &order), None);
    }

    #[test]
    fn clicks_select_one_more_or_all_up_to_there() {
        let order = ["a", "b", "c", "d"].map(str::to_owned);
        let mut selection = Selection::default();
        let mut click = |key: &str, modifiers| {
            selection.click(key, modifiers, &order);
            selection.keys.iter().cloned().collect::<String>()
        };
        assert_eq!(click("c", Modifiers::NONE), "c");
        assert_eq!(click("a", Modifiers::SHIFT), "abc");
        assert_eq!(click("d", Modifiers::SHIFT), "cd", "from where it began");
        assert_eq!(click("a", Modifiers::COMMAND), "acd");
        assert_eq!(click("c", Modifiers::COMMAND), "ad");
        assert_eq!(click("b", Modifiers::NONE), "b");
        assert_eq!(click("b", Modifiers::NONE), "");
        selection.set("a");
        selection.add("c");
        selection.add("a");
        assert!(selection.has("a") && selection.has("c") && selection.keys.len() == 2);
        selection.click_group(&order[..2], Modifiers::NONE);
        selection.click_group(&order[2..3], Modifiers::COMMAND);
        assert_eq!(selection.keys.len(), 3);
        selection.click_group(&order[..2], Modifiers::COMMAND);
        assert!(selection.has("c") && selection.keys.len() == 1);
    }
}
