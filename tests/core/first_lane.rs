//! A file's first lane alone: as good as a file that was built with one lane, and fetched in few parts.

use adjsplat::arena::{Arena, FirstLane};
use adjsplat::splat::{Orbit, Settings};
use adjsplat::{Build, Model, TransferFunction, Volume};

/// An .adj file of a ball with the lanes x, y and z.
fn file() -> Vec<u8> {
    let at = |i: u16| [i % 20, i / 20 % 24, i / 480].map(|c| f32::from(c) - 10.0);
    let value = |i: u16| 200.0 - 18.0 * at(i).iter().map(|c| c * c).sum::<f32>().sqrt();
    let volume = Volume::new([20, 24, 22], (0..20 * 24 * 22).map(value).collect::<Vec<_>>()).unwrap();
    let model = Build::new(TransferFunction::range(60.0, 255.0).unwrap()).run(&volume).unwrap();
    model.arena().unwrap().bytes().to_vec()
}

/// The smaller file, as a page would put it together.
fn fetched(file: &[u8], plan: FirstLane) -> Vec<u8> {
    let FirstLane { mut bytes, parts } = plan;
    for (range, at) in parts {
        let [start, end] = [range.start, range.end].map(|at| usize::try_from(at).unwrap());
        let part = &file[start..end];
        bytes[at..at + part.len()].copy_from_slice(part);
    }
    bytes
}

#[test]
fn it_is_a_valid_file_that_draws_the_same_pictures() {
    let whole = file();
    let head = &whole[..whole.len().min(usize::try_from(FirstLane::HEAD).unwrap())];
    let plan = FirstLane::new(head, whole.len() as u64, "ball.adj").unwrap();
    assert_eq!(plan.parts.len(), 1, "description and first lane lie together");
    let wanted: u64 = plan.parts.iter().map(|(range, _)| range.end - range.start).sum();
    assert!(wanted * 100 < 45 * whole.len() as u64, "{wanted} of {}", whole.len());
    let part = fetched(&whole, plan);
    let arena = Arena::new(&part).unwrap();
    arena.check().unwrap();
    assert_eq!(arena.lanes().count(), 1);
    let (all, one) = (Model::from_bytes(whole).unwrap(), Model::from_bytes(part).unwrap());
    assert_eq!((all.grid(), all.transfer()), (one.grid(), one.transfer()));
    for (azimuth, elevation) in [(0.0, 0.0), (90.0, 10.0), (20.0, 80.0)] {
        let (orbit, settings) = (Orbit { azimuth, elevation, ..Orbit::default() }, Settings::new([60, 50]));
        let picture = |model: &Model| model.render(&orbit, &settings).unwrap();
        assert!(picture(&all).pixels() == picture(&one).pixels(), "{azimuth} {elevation}");
    }
}

#[test]
fn a_file_with_one_lane_stays_as_it_is() {
    let whole = file();
    let plan = FirstLane::new(&whole, whole.len() as u64, "ball.adj").unwrap();
    let one = fetched(&whole, plan);
    let again = FirstLane::new(&one, one.len() as u64, "one.adj").unwrap();
    assert!(fetched(&one, again) == one);
}

#[test]
fn a_wrong_length_and_a_cut_head_are_named() {
    let whole = file();
    let fault = |head: &[u8], len: u64| FirstLane::new(head, len, "ball.adj").unwrap_err().to_string();
    assert!(fault(&whole, whole.len() as u64 + 1).contains("was cut or grew"));
    assert!(fault(&whole[..100], whole.len() as u64).contains("a header of 256 bytes"));
    assert!(fault(&whole[..300], whole.len() as u64).contains("a table of"));
    assert!(fault(b"<!doctype html>", 15).starts_with("ball.adj"));
}
