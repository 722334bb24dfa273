//! Requests that are not edits of the look: pushed while the window is drawn, applied before the next frame.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use clerestory_transport::archive;
use clerestory_transport::camera::Camera;
use clerestory_transport::lamp_units::LampUnits;
use clerestory_transport::lamps::LampShape;
use serde::{Deserialize, Serialize};

use crate::output::{PendingFile, ends_in_separator};
use crate::panels::lamps::Pulled;
use crate::picture::DeviceWish;
use crate::sequence::Pattern;
use crate::words::in_words;

/// What a person asked for.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Ask for a file, in the desktop's dialog and in a path field.
    Ask(FileTask),
    /// Open a scene, a finished bake, or a folder of pictures.
    Open(PathBuf),
    /// Open the scene that is part of the program.
    OpenBuiltIn,
    /// Take over a look.
    OpenLook(PathBuf),
    /// Add the looks of a file to those that there are.
    AddLooks(PathBuf),
    /// Save the look.
    SaveLook(PathBuf),
    /// Save the look where it was saved last, else ask.
    SaveLookAgain,
    /// Write the picture that is seen.
    ExportImage(PathBuf),
    /// Put the picture that is seen on the clipboard.
    CopyImage,
    /// Keep the bake for `clerestory relight`.
    SaveBake(PathBuf),
    /// Bake with the settings of the bake panel.
    StartBake,
    /// The same by its key: what was stopped goes on, and what runs like that is not begun again.
    BakeByKey,
    /// Open the file again that changed on disk, with the look as it is.
    Reload,
    /// Go on with the bake that was stopped.
    ResumeBake,
    /// Give up what is being opened; what is open stays.
    CancelOpening,
    /// Let what was read take its place, whatever was changed while it was read.
    TakeOpened,
    /// Stop the bake and keep what was done.
    CancelBake,
    /// Lets the program take no more memory than this, bytes, while it bakes; what the system has left without.
    LimitMemory(Option<u64>),
    /// Turn an emissive rectangle into a panel of texels, or back, and bake again.
    ChoosePanel {
        /// Key of the light.
        node: String,
        /// Texels along each side; none where it is no panel any more.
        resolution: Option<u32>,
    },
    /// Take the numbers of the scene's lamps in other units and bake again.
    ChooseUnits(LampUnits),
    /// Bake again under the sky of the look, in patches with so many divisions; without one in the look under sun and clear sky.
    BakeWithSky {
        /// Divisions of each of Tregenza's patches.
        divisions: u32,
    },
    /// Bake again without columns for a sky.
    BakeWithoutSky,
    /// Light the scene by a map of the sky.
    UseSky(PathBuf),
    /// Add a free lamp where a pixel of the film sees a surface; in the middle of the view if none is named.
    AddLamp {
        /// What it is.
        shape: LampShape,
        /// Pixels from the top left corner of the film.
        at_px: Option<[f32; 2]>,
    },
    /// Ask for the profile of a lamp to add.
    AskProfile {
        /// See [`Action::AddLamp`].
        at_px: Option<[f32; 2]>,
    },
    /// Ask for the profile of a lamp that is there.
    AskProfileFor(String),
    /// Add a lamp with a measured distribution, or give it to the lamp that it was asked for.
    AddProfile(PathBuf),
    /// Put a free lamp in the place of a lamp of the file.
    MakeMovable(String),
    /// The same for one that the pointer pulls at: it is held from then on.
    PullLamp {
        /// Key of the lamp.
        key: String,
        /// Where the pointer went down, points.
        at: [f32; 2],
    },
    /// Put the lamp back into the file that is being pulled out of it.
    PutBack(Box<Pulled>),
    /// Add copies of the chosen lamps.
    DuplicateLamp,
    /// Add a free copy of a lamp of the file, which stays as it is.
    CopyLamp(String),
    /// Take the chosen lamp away.
    DeleteLamp,
    /// Bakes again, with how lamps that are moved light the room by way of its surfaces.
    BakePatches,
    /// Takes away what was chosen last: a key of the timeline, or lamps.
    DeleteChosen,
    /// Look for the lights that come closest to the wishes.
    Solve,
    /// Take over the lights that were found.
    AcceptSolution,
    /// Leave the lights as they were.
    DiscardSolution,
    /// Wish for a picture to be matched.
    MatchPicture(PathBuf),
    /// Bake again with the light that arrives at each pixel.
    BakeIlluminance,
    /// Write the table of lamps.
    SaveSchedule(PathBuf),
    /// Write what the points of the sensor grids read.
    SaveValues(PathBuf),
    /// Let the next click say what the chosen lamp is to light, or no longer.
    AimLamp,
    /// Light the scene as a snapshot says, counted from 0.
    TakeLook(usize),
    /// Write the scene with its lights as they are.
    ExportGltf(PathBuf),
    /// Play the timeline, or stay where it is.
    PlayTimeline,
    /// Write the frames of the timeline.
    ExportFrames(PathBuf),
    /// Write the pictures of all snapshots on one sheet.
    SaveSheet(PathBuf),
    /// Stop writing frames; those that are there stay.
    CancelFrames,
    /// Take a file as the scene of the bake that was opened.
    UseScene(PathBuf),
    /// Take back the last edit.
    Undo,
    /// Do again what was taken back.
    Redo,
    /// Relight on another device.
    UseDevice(DeviceWish),
    /// Show the whole picture.
    FitPicture,
    /// Put the camera down, back to the view that is shown.
    LeaveCamera,
    /// Take the camera in hand, or put it down.
    ToggleCamera,
    /// Look from a camera of the file or a bookmark.
    LookFrom(Box<Camera>),
    /// Give the present view a name.
    NameView(String),
    /// Show another view that is baked.
    ShowView(u64),
    /// Show the baked view so many places after the one that is shown; the first comes after the last.
    StepView(isize),
    /// Free the memory of a view that is baked.
    ForgetView(u64),
    /// Show a pixel of the picture on each pixel of the screen.
    OneToOne,
    /// Zoom to the rectangle that is dragged next in the picture.
    ZoomToRegion,
    /// Hides all panels but the bars, or shows them again.
    TogglePanels,
    /// Closes one of the panels at the sides, or opens it.
    TogglePanel(Side),
    /// Show or hide the list of keyboard shortcuts.
    ToggleShortcuts,
    /// Fill the screen with the window, or no longer.
    ToggleFullScreen,
    /// Close the window; what would be lost is asked about first.
    CloseWindow,
    /// Close the window, whatever was not saved.
    Quit,
}

impl Action {
    /// Whether a file is made of what is open.
    pub fn writes(&self) -> bool {
        let is_look = matches!(self, Action::SaveLook(_) | Action::SaveLookAgain);
        let is_picture = matches!(self, Action::ExportImage(_) | Action::ExportFrames(_) | Action::SaveSheet(_));
        let is_scene = matches!(self, Action::ExportGltf(_) | Action::SaveBake(_));
        let is_table = matches!(self, Action::SaveSchedule(_) | Action::SaveValues(_));
        is_look || is_picture || is_scene || is_table
    }
}

/// A panel beside the picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Side {
    /// Sky, lights and lamps, at the left.
    Lights,
    /// Display, camera, wishes and bake, at the right.
    Settings,
}

/// What a file is wanted for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileTask {
    /// A scene or a bake to open.
    OpenScene,
    /// A folder of pictures to open, each under one light.
    OpenPictures,
    /// A look to open.
    OpenLook,
    /// A file whose looks are added to those that there are.
    AddLooks,
    /// A place for the look.
    SaveLook,
    /// A place for the picture.
    Export,
    /// A place for the scene with its lights.
    ExportGltf,
    /// Names for the frames of the timeline.
    ExportFrames,
    /// A place for the sheet of looks.
    SaveSheet,
    /// A place for the bake.
    SaveBake,
    /// The distribution of a lamp.
    OpenProfile,
    /// The scene of a bake.
    FindScene,
    /// A picture to match.
    OpenTarget,
    /// A map of the sky.
    OpenSky,
    /// A place for the table of lamps.
    SaveSchedule,
    /// A place for the table of sensors.
    SaveValues,
}

impl FileTask {
    /// Title of its dialog.
    pub fn title(self) -> &'static str {
        match self {
            FileTask::OpenScene => "Open a scene",
            FileTask::OpenPictures => "Open a folder of pictures",
            FileTask::OpenLook => "Open a look",
            FileTask::AddLooks => "Add the looks of a file",
            FileTask::SaveLook => "Save the look",
            FileTask::Export => "Export the picture",
            FileTask::ExportFrames => "Export the frames",
            FileTask::ExportGltf => "Save the scene with its lights",
            FileTask::SaveSheet => "Save a contact sheet of the looks",
            FileTask::SaveBake => "Save the bake",
            FileTask::OpenProfile => "Open the profile of a lamp",
            FileTask::FindScene => "Choose the scene of this bake",
            FileTask::OpenTarget => "Open a picture to match",
            FileTask::OpenSky => "Open a picture of the sky",
            FileTask::SaveSchedule => "Save the schedule of lamps",
            FileTask::SaveValues => "Save the values of the sensors",
        }
    }

    /// What the files are, for people, and their endings; the first one is added where a name has none. Folders have none.
    pub fn extensions(self) -> (&'static str, &'static [&'static str]) {
        match self {
            FileTask::OpenScene => ("glTF scenes and bakes", &["glb", "gltf", "transport"]),
            FileTask::OpenPictures => ("Folders", &[]),
            FileTask::OpenLook | FileTask::AddLooks | FileTask::SaveLook => ("Looks", &["look"]),
            FileTask::Export | FileTask::ExportFrames => ("Pictures", &["png", "exr"]),
            FileTask::SaveSheet => ("Pictures", &["png"]),
            FileTask::SaveBake => ("Bakes", &["transport"]),
            FileTask::OpenProfile => ("Profiles of lamps", PROFILE_EXTENSIONS),
            FileTask::FindScene | FileTask::ExportGltf => ("glTF scenes", &["glb", "gltf"]),
            FileTask::OpenTarget => ("Pictures", &["exr", "hdr", "png", "jpg", "jpeg"]),
            FileTask::OpenSky => ("Pictures of all directions", SKY_EXTENSIONS),
            FileTask::SaveSchedule | FileTask::SaveValues => ("Tables", &["csv"]),
        }
    }

    /// Whether more than the file's name is asked, so that the desktop's dialog waits until it is wanted.
    pub fn asks_more(self) -> bool {
        matches!(self, FileTask::Export | FileTask::ExportFrames)
    }

    /// Whether a file is written.
    pub fn writes(self) -> bool {
        matches!(
            self,
            FileTask::SaveLook
                | FileTask::Export
                | FileTask::ExportFrames
                | FileTask::ExportGltf
                | FileTask::SaveSheet
                | FileTask::SaveBake
                | FileTask::SaveSchedule
                | FileTask::SaveValues
        )
    }

    /// Whether what is seen is written.
    pub fn writes_pictures(self) -> bool {
        matches!(self, FileTask::Export | FileTask::ExportFrames | FileTask::SaveSheet)
    }

    /// The file that is meant by a path: one to be written gets an ending where it has none. Of files of a single kind, what stands
    /// behind another dot is a part of the name, unless a file is called so.
    pub fn whole(self, path: PathBuf) -> PathBuf {
        let is_named = path.file_name().is_some() && !ends_in_separator(&path);
        if !self.writes() || !is_named || self.has_ending(&path) {
            return path;
        }
        let mut name = path.into_os_string();
        name.push(".");
        name.push(self.extensions().1[0]);
        name.into()
    }

    fn has_ending(self, path: &Path) -> bool {
        let is_single =
            matches!(self, FileTask::SaveLook | FileTask::SaveBake | FileTask::SaveSchedule | FileTask::SaveValues);
        let is_own = |own: &OsStr| self.extensions().1.iter().any(|ending| own.eq_ignore_ascii_case(ending));
        path.extension().is_some_and(|own| !is_single || is_own(own) || path.is_file())
    }

    /// Why nothing can be written or read at a path, in words; nothing where it can.
    pub fn refusal(self, path: &Path) -> Option<String> {
        if self.writes() {
            return PendingFile::create(path).err().map(|error| in_words(&error));
        }
        let is_missing = path.try_exists().is_ok_and(|is_there| !is_there);
        is_missing.then(|| format!("there is no {}; check the path", path.display()))
    }

    /// Whether something is there that is replaced if a path is written.
    pub fn replaces(self, path: &Path) -> bool {
        match self {
            FileTask::ExportFrames => Pattern::new(path).is_ok_and(|pattern| pattern.has_files()),
            _ => self.writes() && path.is_file(),
        }
    }

    /// What happens once a file is chosen.
    pub fn action(self, path: PathBuf) -> Action {
        let path = self.whole(path);
        match self {
            FileTask::OpenScene => opened(path),
            FileTask::OpenPictures => Action::Open(path),
            FileTask::OpenLook => Action::OpenLook(path),
            FileTask::AddLooks => Action::AddLooks(path),
            FileTask::SaveLook => Action::SaveLook(path),
            FileTask::Export => Action::ExportImage(path),
            FileTask::ExportFrames => Action::ExportFrames(path),
            FileTask::ExportGltf => Action::ExportGltf(path),
            FileTask::SaveSheet => Action::SaveSheet(path),
            FileTask::SaveBake => Action::SaveBake(path),
            FileTask::OpenProfile => Action::AddProfile(path),
            FileTask::FindScene => Action::UseScene(path),
            FileTask::OpenTarget => Action::MatchPicture(path),
            FileTask::OpenSky => Action::UseSky(path),
            FileTask::SaveSchedule => Action::SaveSchedule(path),
            FileTask::SaveValues => Action::SaveValues(path),
        }
    }
}

/// Endings of maps of the sky.
const SKY_EXTENSIONS: &[&str] = &["hdr", "exr"];
/// Endings of pictures as they are seen, which are neither scenes nor skies.
const SEEN_EXTENSIONS: &[&str] = &["png", "jpg", "jpeg"];
/// Endings of measured distributions.
const PROFILE_EXTENSIONS: &[&str] = &["ies", "ldt"];

/// What to do with files that were dropped on the window together: what is for a scene comes after it.
pub fn all_dropped(paths: impl Iterator<Item = PathBuf>) -> Vec<Action> {
    let mut actions: Vec<Action> = paths.map(dropped).collect();
    actions.sort_by_key(|action| !matches!(action, Action::Open(_)));
    actions
}

/// What to do with a file that was dropped on the window: pictures as they are seen are to be matched, the others are opened.
pub fn dropped(path: PathBuf) -> Action {
    if ends_in(&path, SEEN_EXTENSIONS) { Action::MatchPicture(path) } else { opened(path) }
}

/// What to do with a file that is opened: looks and skies are taken over, profiles become lamps, everything else is a scene.
pub fn opened(path: PathBuf) -> Action {
    match () {
        () if is_look(&path) => Action::OpenLook(path),
        () if ends_in(&path, SKY_EXTENSIONS) => Action::UseSky(path),
        () if ends_in(&path, PROFILE_EXTENSIONS) => Action::AddProfile(path),
        () => Action::Open(path),
    }
}

/// Whether a path is that of a look, by its ending.
pub fn is_look(path: &Path) -> bool {
    ends_in(path, &["look"])
}

/// Whether a file is a bake, by its ending, else by its first bytes.
pub fn is_transport(path: &Path) -> bool {
    ends_in(path, &["transport"]) || archive::is_transport(path)
}

fn ends_in(path: &Path, endings: &[&str]) -> bool {
    path.extension().is_some_and(|own| endings.iter().any(|ending| own.eq_ignore_ascii_case(ending)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_without_an_ending_gets_one_and_others_keep_theirs() {
        assert_eq!(FileTask::Export.action("a".into()), Action::ExportImage("a.png".into()));
        assert_eq!(FileTask::Export.action("a.exr".into()), Action::ExportImage("a.exr".into()));
        assert_eq!(FileTask::OpenScene.action("a".into()), Action::Open("a".into()));
        let look = Action::OpenLook("a.look".into());
        assert_eq!(FileTask::OpenScene.action("a.look".into()), look, "whatever is opened goes where it belongs");
    }

    #[test]
    fn every_file_that_is_asked_for_to_be_written_is_written_by_an_action_that_says_so() {
        let read = [FileTask::OpenScene, FileTask::OpenLook, FileTask::OpenSky, FileTask::FindScene];
        let written = [
            FileTask::SaveLook,
            FileTask::Export,
            FileTask::ExportFrames,
            FileTask::ExportGltf,
            FileTask::SaveSheet,
            FileTask::SaveBake,
            FileTask::SaveSchedule,
            FileTask::SaveValues,
        ];
        for task in read.into_iter().chain(written) {
            assert_eq!(task.action("a".into()).writes(), task.writes(), "{task:?}");
        }
    }

    #[test]
    fn a_dot_in_the_name_of_a_look_is_no_ending() {
        for (name, whole) in [("Hall v1.2", "Hall v1.2.look"), ("a.LOOK", "a.LOOK"), ("", ""), ("none/", "none/")] {
            assert_eq!(FileTask::SaveLook.whole(name.into()), PathBuf::from(whole));
        }
        assert_eq!(FileTask::SaveBake.whole("b.glb".into()), PathBuf::from("b.glb.transport"));
        assert_eq!(FileTask::Export.whole("a.jpg".into()), PathBuf::from("a.jpg"), "the dialog says what is wrong");
        let folder = tempfile::tempdir().unwrap();
        let old = folder.path().join("old.json");
        std::fs::write(&old, "{}").unwrap();
        assert_eq!(FileTask::SaveLook.whole(old.clone()), old, "it is there, and may be replaced");
        for (task, path) in [(FileTask::SaveLook, "b.look"), (FileTask::OpenLook, "old.json")] {
            assert_eq!(task.refusal(&folder.path().join(path)), None);
        }
        for (task, path) in [(FileTask::SaveLook, "none/b.look"), (FileTask::OpenLook, "none.look")] {
            assert!(task.refusal(&folder.path().join(path)).is_some_and(|words| words.contains("none")));
        }
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "it was tried without a trace");
    }

    #[test]
    fn dropped_looks_and_skies_are_taken_over_profiles_added_and_scenes_opened() {
        assert_eq!(dropped("warm.LOOK".into()), Action::OpenLook("warm.LOOK".into()));
        assert_eq!(dropped("day.HDR".into()), Action::UseSky("day.HDR".into()));
        assert_eq!(dropped("track.IES".into()), Action::AddProfile("track.IES".into()));
        assert_eq!(dropped("track.ldt".into()), Action::AddProfile("track.ldt".into()));
        assert_eq!(dropped("room.glb".into()), Action::Open("room.glb".into()));
        assert_eq!(dropped("stage".into()), Action::Open("stage".into()));
        assert_eq!(dropped("photo.JPG".into()), Action::MatchPicture("photo.JPG".into()));
        let scene = FileTask::OpenScene.action("photo.jpg".into());
        assert_eq!(scene, Action::Open("photo.jpg".into()), "who chooses a scene is told that it is none");
        let both = all_dropped(["warm.look", "room.glb"].map(PathBuf::from).into_iter());
        assert_eq!(both, [Action::Open("room.glb".into()), Action::OpenLook("warm.look".into())]);
    }
}
