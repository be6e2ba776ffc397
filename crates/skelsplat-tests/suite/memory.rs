//! Memory is asked for before it is taken.

use skelsplat_core::study::memory::{SMALL, check, of_meminfo};

#[test]
fn meminfo_counts_what_is_available_and_swap() {
    let text = "MemTotal:  9 kB\nMemAvailable:   2000 kB\nSwapFree:  48 kB\n";
    assert_eq!(of_meminfo(text), Some(2048 * 1024));
    assert_eq!(of_meminfo("MemAvailable: 3 kB\n"), Some(3 * 1024));
    assert_eq!(of_meminfo("MemFree: 3 kB\n"), None);
}

#[test]
fn what_no_machine_has_is_refused_with_its_size() {
    check(SMALL, || unreachable!("small sizes are not checked")).unwrap();
    let text = check(1 << 70, || "all stars".to_owned()).unwrap_err().to_string();
    assert!(text.starts_with("all stars need 1180591620717.4 GB"), "{text}");
}
