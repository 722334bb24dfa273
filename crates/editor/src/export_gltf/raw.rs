//! JSON whose members stay as they were written, byte for byte, until they are set.

use std::collections::BTreeMap;
use std::fmt;

use anyhow::{Context, Result, anyhow};
use clerestory_transport::import::legible;
use glam::Vec3;
use serde::de::{DeserializeOwned, MapAccess, Visitor};
use serde::ser::SerializeMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use serde_json::value::{RawValue, to_raw_value};

/// An object, its members in order.
#[derive(Clone, Debug, Default)]
pub(super) struct RawObject(Vec<(String, Box<RawValue>)>);

/// JSON of a value.
pub(super) fn raw(value: &(impl Serialize + ?Sized)) -> Box<RawValue> {
    to_raw_value(value).expect("numbers, texts, lists and objects always have a JSON form")
}

/// A place in a list, which may be written as `2.0` and is read so.
pub(super) fn whole(number: f64) -> Option<usize> {
    (number >= 0.0 && number.fract() == 0.0).then_some(number as usize)
}

impl RawObject {
    /// A member as it was written.
    pub fn get(&self, key: &str) -> Option<&RawValue> {
        self.0.iter().find(|(name, _)| name == key).map(|(_, value)| &**value)
    }

    /// A member, if it is there and has this form.
    pub fn read<T: DeserializeOwned>(&self, key: &str) -> Option<T> {
        serde_json::from_str(self.get(key)?.get()).ok()
    }

    /// A member that is the place of an item in a list.
    pub fn place(&self, key: &str) -> Option<usize> {
        self.read::<f64>(key).and_then(whole)
    }

    /// A member that is a color, without the alpha that some programs write behind it.
    pub fn color(&self, key: &str) -> Option<Vec3> {
        let numbers: Vec<f32> = self.read(key)?;
        numbers.first_chunk::<3>().copied().map(Vec3::from)
    }

    /// Sets a member; one that is new comes last.
    pub fn set(&mut self, key: &str, value: &(impl Serialize + ?Sized)) {
        match self.0.iter_mut().find(|(name, _)| name == key) {
            Some((_, own)) => *own = raw(value),
            None => self.0.push((key.to_owned(), raw(value))),
        }
    }

    /// Sets a member, or takes it away.
    pub fn set_or_remove(&mut self, key: &str, value: Option<&(impl Serialize + ?Sized)>) {
        match value {
            Some(value) => self.set(key, value),
            None => self.0.retain(|(name, _)| name != key),
        }
    }

    /// Whether it has no members.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// What the extras of a node say to us.
    pub fn own_extras(&self) -> RawObject {
        self.read::<RawObject>("extras").and_then(|extras| extras.read(OWN)).unwrap_or_default()
    }

    /// Changes a member that is an object, or makes one.
    pub fn change(&mut self, key: &str, change: impl FnOnce(&mut RawObject)) {
        let mut object = self.read::<RawObject>(key).unwrap_or_default();
        change(&mut object);
        self.set(key, &object);
    }
}

impl Serialize for RawObject {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.0.len()))?;
        self.0.iter().try_for_each(|(key, value)| map.serialize_entry(key, value))?;
        map.end()
    }
}

impl<'de> Deserialize<'de> for RawObject {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Members;
        impl<'de> Visitor<'de> for Members {
            type Value = RawObject;

            fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
                f.write_str("an object")
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<RawObject, A::Error> {
                let mut members = Vec::new();
                while let Some(member) = map.next_entry()? {
                    members.push(member);
                }
                Ok(RawObject(members))
            }
        }
        deserializer.deserialize_map(Members)
    }
}

/// The JSON of a glTF file. Lists are taken apart when something of them is asked for.
#[derive(Debug)]
pub(super) struct Document {
    root: RawObject,
    lists: BTreeMap<&'static str, Vec<Box<RawValue>>>,
}

/// Where the lamps of a file are, as a name of a list.
pub(super) const LAMPS: &str = "KHR_lights_punctual";
/// Where the measured distributions of a file are.
pub(super) const PROFILES: &str = "EXT_lights_ies";
/// Member of a node's extras that is for us.
pub(super) const OWN: &str = "clerestory";

impl Document {
    /// Of a text that is mended as when it was opened.
    ///
    /// # Errors
    /// If it is no JSON object.
    pub fn parse(json: &[u8]) -> Result<Document> {
        let root = serde_json::from_str(&legible(json)).context("its JSON is damaged")?;
        Ok(Document { root, lists: BTreeMap::new() })
    }

    /// A member of the root, if it is there and has this form.
    pub fn read<T: DeserializeOwned>(&self, key: &str) -> Option<T> {
        self.root.read(key)
    }

    fn list(&mut self, name: &'static str) -> &mut Vec<Box<RawValue>> {
        let root = &self.root;
        self.lists.entry(name).or_insert_with(|| {
            if is_extension(name) {
                let extensions = root.read::<RawObject>("extensions").unwrap_or_default();
                extensions.read::<RawObject>(name).and_then(|own| own.read("lights")).unwrap_or_default()
            } else {
                root.read(name).unwrap_or_default()
            }
        })
    }

    /// Number of items of a list.
    pub fn len(&mut self, list: &'static str) -> usize {
        self.list(list).len()
    }

    /// An item of a list.
    ///
    /// # Errors
    /// If there is none of that number.
    pub fn item(&mut self, list: &'static str, idx: usize) -> Result<RawObject> {
        let item = self.list(list).get(idx).ok_or_else(|| anyhow!("it has no item {idx} of `{list}`"))?;
        serde_json::from_str(item.get()).with_context(|| format!("item {idx} of `{list}` is no object"))
    }

    /// Puts an item in its place.
    pub fn put(&mut self, list: &'static str, idx: usize, item: &RawObject) {
        if let Some(slot) = self.list(list).get_mut(idx) {
            *slot = raw(item);
        }
    }

    /// Adds an item and answers its number.
    pub fn push(&mut self, list: &'static str, item: &(impl Serialize + ?Sized)) -> usize {
        let items = self.list(list);
        items.push(raw(item));
        items.len() - 1
    }

    /// Says that the file uses an extension.
    pub fn uses(&mut self, extension: &str) {
        let mut used: Vec<String> = self.root.read("extensionsUsed").unwrap_or_default();
        if !used.iter().any(|name| name == extension) {
            used.push(extension.to_owned());
            self.root.set("extensionsUsed", &used);
        }
    }

    /// The JSON with all that was changed.
    pub fn into_json(self) -> Vec<u8> {
        let Document { mut root, lists } = self;
        for (name, items) in lists.into_iter().filter(|(_, items)| !items.is_empty()) {
            if is_extension(name) {
                root.change("extensions", |all| all.change(name, |own| own.set("lights", &items)));
            } else {
                root.set(name, &items);
            }
        }
        serde_json::to_vec(&root).expect("what was read as JSON can be written")
    }
}

fn is_extension(list: &str) -> bool {
    list == LAMPS || list == PROFILES
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_touched_stays_byte_for_byte() {
        let json = br#"{"z":[1.0,0.10000000149011612,-0,1e-5], "nodes": [{"b":{"x" : 2.50},"a":1e2},{"name":"\u00e9"}],"a":{}}"#;
        let mut document = Document::parse(json).unwrap();
        let mut node = document.item("nodes", 1).unwrap();
        node.change("extensions", |all| all.set("new", &1));
        document.put("nodes", 1, &node);
        document.push(LAMPS, &serde_json::json!({"type": "point"}));
        document.uses(LAMPS);
        let written = String::from_utf8(document.into_json()).unwrap();
        assert_eq!(
            written,
            r#"{"z":[1.0,0.10000000149011612,-0,1e-5],"nodes":[{"b":{"x" : 2.50},"a":1e2},{"name":"\u00e9","extensions":{"new":1}}],"a":{},"extensionsUsed":["KHR_lights_punctual"],"extensions":{"KHR_lights_punctual":{"lights":[{"type":"point"}]}}}"#
        );
        assert!(Document::parse(b"[]").is_err() && Document::parse(b"{}\0 \0\0").is_ok());
    }

    #[test]
    fn letters_that_are_no_utf_8_are_replaced_as_when_the_file_was_opened() {
        // Latin 1.
        let document = Document::parse(b"{\"name\":\"T\xFCr\"}").unwrap();
        assert_eq!(String::from_utf8(document.into_json()).unwrap(), "{\"name\":\"T\u{FFFD}r\"}");
    }
}
