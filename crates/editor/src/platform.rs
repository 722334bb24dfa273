//! What is asked of systems in their own ways, all of it here. Elsewhere the code is the same on Linux, macOS and Windows.

use raw_window_handle::HasWindowHandle;

/// Memory of this process that is in use now, bytes; `None` where the system is not asked.
pub fn resident_bytes() -> Option<u64> {
    status_bytes("self", "VmRSS:")
}

/// The most memory of this process that was ever in use at a time, bytes; `None` where the system is not asked.
pub fn peak_bytes() -> Option<u64> {
    status_bytes("self", "VmHWM:")
}

/// The same of another process that runs.
pub fn peak_bytes_of(process: u32) -> Option<u64> {
    status_bytes(&process.to_string(), "VmHWM:")
}

/// Gives a window the keyboard where nobody else does: under X11 that is the matter of a window manager, and kiosks and virtual screens have
/// none. `None` where it is not ours to do; else whether it was given, which it is not before the window is on the screen.
pub fn give_keyboard(window: &impl HasWindowHandle) -> Option<bool> {
    let handle = window.window_handle().ok()?.as_raw();
    #[cfg(target_os = "linux")]
    if let raw_window_handle::RawWindowHandle::Xlib(handle) = handle {
        return give_keyboard_of_x11(u32::try_from(handle.window).ok()?);
    }
    let _ = handle;
    None
}

/// The same of a window of the X server.
#[cfg(target_os = "linux")]
fn give_keyboard_of_x11(window: u32) -> Option<bool> {
    use x11rb::connection::Connection;
    use x11rb::protocol::xproto::{ConnectionExt, EventMask, InputFocus};

    let (display, screen) = x11rb::connect(None).ok()?;
    let root = display.setup().roots.get(screen)?.root;
    let watched = display.get_window_attributes(root).ok()?.reply().ok()?.all_event_masks;
    // That is what window managers ask for, and only one at a time may.
    if watched.contains(EventMask::SUBSTRUCTURE_REDIRECT) {
        return None;
    }
    let asked = display.set_input_focus(InputFocus::PARENT, window, x11rb::CURRENT_TIME).ok()?;
    Some(asked.check().is_ok())
}

/// Memory that programs can still take without others being put out to disk, bytes; `None` where the system is not asked.
pub fn available_bytes() -> Option<u64> {
    #[cfg(target_os = "linux")]
    {
        line_bytes(&std::fs::read_to_string("/proc/meminfo").ok()?, "MemAvailable:")
    }
    #[cfg(windows)]
    {
        memory_of_windows().map(|[_, left]| left)
    }
    #[cfg(not(any(target_os = "linux", windows)))]
    None
}

/// All memory that the system has for programs and for itself, bytes; `None` where it is not asked.
pub fn memory_bytes() -> Option<u64> {
    #[cfg(target_os = "linux")]
    {
        line_bytes(&std::fs::read_to_string("/proc/meminfo").ok()?, "MemTotal:")
    }
    #[cfg(target_os = "macos")]
    {
        memory_of_macos()
    }
    #[cfg(windows)]
    {
        memory_of_windows().map(|[all, _]| all)
    }
    #[cfg(not(any(target_os = "linux", target_os = "macos", windows)))]
    None
}

/// All memory of a Mac, bytes.
#[cfg(target_os = "macos")]
#[expect(unsafe_code, reason = "the C library has no safe name for it")]
fn memory_of_macos() -> Option<u64> {
    let (mut bytes, mut length) = (0_u64, size_of::<u64>());
    let (name, nothing) = (c"hw.memsize", std::ptr::null_mut());
    // SAFETY: the name ends with a zero, no more than `length` bytes are written to the number, and nothing is set.
    let status = unsafe {
        libc::sysctlbyname(name.as_ptr(), (&raw mut bytes).cast::<libc::c_void>(), &raw mut length, nothing, 0)
    };
    (status == 0 && length == size_of::<u64>()).then_some(bytes)
}

/// All memory of Windows, and what of it is left, bytes.
#[cfg(windows)]
#[expect(unsafe_code, reason = "the standard library has no name for it")]
fn memory_of_windows() -> Option<[u64; 2]> {
    /// As `MEMORYSTATUSEX` lies in memory.
    #[repr(C)]
    #[derive(Default)]
    struct MemoryStatus {
        length: u32,
        percent_used: u32,
        all: u64,
        left: u64,
        of_files_and_addresses: [u64; 5],
    }
    #[link(name = "kernel32")]
    unsafe extern "system" {
        fn GlobalMemoryStatusEx(status: *mut MemoryStatus) -> i32;
    }
    let mut status = MemoryStatus { length: size_of::<MemoryStatus>() as u32, ..MemoryStatus::default() };
    // SAFETY: the structure is as the system defines it, and says its own length.
    let is_told = unsafe { GlobalMemoryStatusEx(&raw mut status) } != 0;
    is_told.then_some([status.all, status.left])
}

/// The value of a line `name: N kB`.
#[cfg(target_os = "linux")]
fn line_bytes(lines: &str, name: &str) -> Option<u64> {
    let line = lines.lines().find_map(|line| line.strip_prefix(name))?;
    let kilobytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kilobytes * 1024)
}

/// A line of what Linux says of a process.
fn status_bytes(process: &str, name: &str) -> Option<u64> {
    #[cfg(target_os = "linux")]
    {
        line_bytes(&std::fs::read_to_string(format!("/proc/{process}/status")).ok()?, name)
    }
    #[cfg(not(target_os = "linux"))]
    {
        let _ = (process, name);
        None
    }
}

/// Whether this process was started so that it outlives its terminal, as `nohup` does; `None` where the system is not asked.
pub fn ignores_hangups() -> Option<bool> {
    #[cfg(target_os = "linux")]
    {
        let status = std::fs::read_to_string("/proc/self/status").ok()?;
        let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"))?;
        // A bit for each signal, from the lowest on: this one is the first.
        Some(u128::from_str_radix(ignored.trim(), 16).ok()? & 1 == 1)
    }
    #[cfg(not(target_os = "linux"))]
    None
}

/// Has writing beyond the size that files may have (`ulimit -f`) fail as it does on a full disk. Of itself, the system ends a program there,
/// in the middle of its file.
pub fn outlive_limits_of_files() {
    #[cfg(unix)]
    {
        // Whoever listens lives on; nobody asks for what was heard. Where that is refused, all stays as it was.
        let _ = signal_hook::flag::register(signal_hook::consts::SIGXFSZ, std::sync::Arc::default());
    }
}

/// Has the system run other threads before this one, where both want a processor: as a nice value of 5 does on Linux, “below normal” on
/// Windows, and 5 below the 31 that threads begin with on macOS.
pub fn step_back() {
    use thread_priority::{ThreadPriority, ThreadPriorityValue, set_current_thread_priority};
    // On a scale of 100; macOS takes the number as it is.
    const LOW: u8 = if cfg!(target_os = "macos") { 26 } else { 35 };
    let low = ThreadPriorityValue::try_from(LOW).map(ThreadPriority::Crossplatform);
    // Where that is refused, all threads share alike, as they did before: slower for who waits, and nothing else.
    let _ = low.map(set_current_thread_priority);
}

/// Gives large memory back to the system as soon as it is freed. Of itself, the allocator of GNU/Linux takes what was freed once for
/// what will be asked for again, and keeps it for each of its threads: half an hour of opening and baking nearly tripled the memory of the window.
#[cfg_attr(
    all(target_os = "linux", target_env = "gnu"),
    expect(unsafe_code, reason = "the C library has no safe name for it")
)]
pub fn return_freed_memory() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    {
        /// From here on memory is large, bytes. Smaller values take the system's time: a bake frees its blocks again and again.
        const LARGE: libc::c_int = 1 << 20;
        for option in [libc::M_MMAP_THRESHOLD, libc::M_TRIM_THRESHOLD] {
            // SAFETY: it sets a number of the allocator, which has a lock for that.
            let is_set = unsafe { libc::mallopt(option, LARGE) } == 1;
            debug_assert!(is_set, "the allocator does not know option {option}");
        }
    }
}

/// Gives back to the system what was freed in small pieces, which the allocator of GNU/Linux keeps: of 277 MB after some minutes of opening
/// and baking, 101. Takes some milliseconds.
#[cfg_attr(
    all(target_os = "linux", target_env = "gnu"),
    expect(unsafe_code, reason = "the C library has no safe name for it")
)]
pub fn trim_freed_memory() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: it works on what is free, under the allocator's locks.
    unsafe {
        libc::malloc_trim(0);
    }
}

/// What the operating system counts of this thread.
#[derive(Clone, Copy)]
pub struct ThreadTimes {
    /// How long it had a core.
    pub ran: std::time::Duration,
    /// How long it was ready to run and others had the cores.
    pub waited: std::time::Duration,
}

/// The times of this thread until now; `None` where the system is not asked.
pub fn thread_times() -> Option<ThreadTimes> {
    #[cfg(target_os = "linux")]
    {
        let times = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
        let mut times = times.split_whitespace().map(|ns| ns.parse().ok().map(std::time::Duration::from_nanos));
        Some(ThreadTimes { ran: times.next()??, waited: times.next()?? })
    }
    #[cfg(not(target_os = "linux"))]
    None
}

/// Whether a window can be hoped for. Only X11 and Wayland say beforehand.
pub fn has_display() -> bool {
    let is_set = |name: &str| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    !cfg!(all(unix, not(target_os = "macos"))) || is_set("DISPLAY") || is_set("WAYLAND_DISPLAY")
}

/// Nodes of the drivers of graphics hardware on Linux: kernel drivers, NVIDIA's own, Windows' subsystem, phones.
#[cfg(target_os = "linux")]
const GPU_NODES: [&str; 5] = ["/dev/dri", "/dev/nvidiactl", "/dev/dxg", "/dev/kgsl-3d0", "/dev/mali0"];

/// Whether it is worth asking for hardware. Graphics libraries write complaints of their own to stderr when they are asked
/// where there is neither hardware nor a session.
pub fn may_have_gpu() -> bool {
    #[cfg(target_os = "linux")]
    return GPU_NODES.iter().any(|node| std::path::Path::new(node).exists());
    #[cfg(not(target_os = "linux"))]
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[cfg(target_os = "linux")]
    #[test]
    fn a_thread_that_steps_back_does_so_alone() {
        let nice = || -> i32 {
            let stat = std::fs::read_to_string("/proc/thread-self/stat").unwrap();
            // Behind the name, which may hold spaces, nice is the 17th field.
            stat.rsplit_once(')').unwrap().1.split_whitespace().nth(16).unwrap().parse().unwrap()
        };
        let before = nice();
        if before >= 5 {
            return println!("skipped: the tests were started with a low priority");
        }
        let stepped = std::thread::spawn(move || {
            step_back();
            nice()
        });
        assert!(stepped.join().unwrap() > before);
        assert_eq!(nice(), before);
    }

    #[test]
    fn the_system_has_more_memory_than_is_still_to_be_had() {
        let Some((all, available)) = memory_bytes().zip(available_bytes()) else { return };
        assert!(0 < available && available < all, "{available} of {all}");
    }

    #[test]
    fn what_is_in_use_grows_with_what_is_touched() {
        let Some(before) = resident_bytes() else { return };
        // Neither optimized away nor outweighed by what other tests let go meanwhile.
        let touched = std::hint::black_box(vec![1u8; 512 << 20]);
        let after = resident_bytes().expect("it was told before");
        assert!(after > before + (128 << 20), "{before} {after}");
        drop(touched);
        let peak = peak_bytes().expect("it was told before");
        assert!(peak > before + (128 << 20), "{peak} is the most, and {before} was there before");
    }
}
