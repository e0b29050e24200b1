//! `docs/OPTICS.md` has the numbers that the renderers have.

use adjsplat::internals::LOW_PASS;
use adjsplat::splat::{Lighting, Quality};

fn page() -> String {
    std::fs::read_to_string(adjsplat_tests::repository().join("docs/OPTICS.md")).unwrap()
}

/// Returns the cells of the table row that is `below` rows below the one whose first cell is `first`.
fn cells(page: &str, first: &str, below: usize) -> Vec<String> {
    let row = page.lines().skip_while(|line| !line.starts_with(&format!("| {first} |"))).nth(below);
    let row = row.unwrap_or_else(|| panic!("no row {first}"));
    row.trim_matches('|').split('|').map(|cell| cell.trim().to_owned()).collect()
}

/// Returns the number in a cell: `3 (4.29)`, `1/128` or `1e-5`.
fn number(cell: &str) -> f32 {
    let word = cell.split(' ').next().unwrap();
    match word.split_once('/') {
        Some((above, below)) => above.parse::<f32>().unwrap() / below.parse::<f32>().unwrap(),
        None => word.parse().unwrap(),
    }
}

#[test]
fn the_page_on_optics_has_the_light_that_is_drawn() {
    let Lighting { ambient, diffuse, specular, shininess, toward_light: [x, y, z] } = Lighting::default();
    let weights: Vec<f32> = cells(&page(), "ambient", 2).iter().map(|cell| number(cell)).collect();
    assert_eq!(weights, [ambient, diffuse, specular, shininess.into()]);
    assert_eq!(z, 1.0);
    assert!(page().contains(&format!("l = unit({x} r + {y} u - f)")));
}

#[test]
fn the_page_on_optics_has_each_qualitys_kernel_and_end_of_rays() {
    for quality in Quality::ALL {
        let row = cells(&page(), &format!("`--quality {}`", quality.name()), 0);
        let kernel = quality.kernel();
        assert_eq!(number(&row[1]), kernel.radius, "{}", quality.name());
        let cut_off: f32 = row[1].split(['(', ')']).nth(1).unwrap().parse().unwrap();
        assert!((cut_off - kernel.radius / kernel.sigma).abs() < 0.005, "{}", quality.name());
        assert_eq!(number(&row[2]), quality.termination(), "{}", quality.name());
        assert!(page().contains(&format!("standard deviation sigma = {}", kernel.sigma)));
    }
    assert!(page().contains(&format!("makes the narrower one {LOW_PASS} pixels wide")));
}
