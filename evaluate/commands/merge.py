"""`python -m evaluate merge FOLDER ...`: put the parts of an evaluation (`--part`) together to one run."""

import sys
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro

from evaluate.commands.options import Flag
from evaluate.commands.outputs import write_results
from evaluate.commands.plan import check_baseline, check_folder
from evaluate.records import manifest as manifests
from evaluate.records.manifest import Manifest
from evaluate.records.parts import StoredPart, gaps_and_overlaps, join_parts, read_part
from evaluate.records.store import is_unfinished, remove_chunks
from quad_env.cli.command_line import UsageError
from quad_env.files.writing import exclusive_lock

PROCESSOR_VERSIONS = ("blas", "simd")
"""Names of the versions that depend on the processor of the machine; `--any-processor` accepts other ones."""


@dataclass(frozen=True)
class MergeOptions:
    """Folders of the parts, and the folder of the merged run."""

    folders: Annotated[tuple[Path, ...], tyro.conf.Positional]
    """Folders of all parts of one run, in any order: parts/*."""
    out: Path = Path("results/evaluation")
    """Folder for results.json, episodes.parquet, report.html and manifest.json; files of these names are replaced."""
    baseline: str | None = None
    """Policy to compare the others with; by default trot, or without it the policy named first."""
    any_processor: Flag = False
    """Merge parts from machines with different processors. The last bits of their results can differ; comparisons stay
    paired, because each part has all policies of its episodes."""


def main(options: MergeOptions) -> int:
    """Merge the parts of a run, and write the files of the run; return the exit code 0.

    UsageError is raised if the parts are not exactly the parts of one run.
    """
    parts = _read_parts(options)
    manifest = _merged_manifest([part.manifest for part in parts])
    check_baseline(options.baseline, list(manifest.policies))
    if options.out.resolve() in {part.folder.resolve() for part in parts}:
        raise UsageError(f"--out: {options.out} is the folder of a part; valid: another folder")
    check_folder(options.out)
    if is_unfinished(options.out):
        print(f"{options.out} holds an unfinished run, which is replaced now", file=sys.stderr)
    with exclusive_lock(options.out):
        manifest.write(options.out)
        write_results(join_parts(parts, manifest), options.out, options.baseline)
        remove_chunks(options.out)
    return 0


def _read_parts(options: MergeOptions) -> list[StoredPart]:
    """Read all parts in the order of their numbers, and check that they are exactly the parts of one run.

    Args:
        options: Options of the command line.

    Returns:
        The parts.

    Raises:
        UsageError: A part is missing, given twice, not finished, damaged, or of another run.
    """
    errors = []
    parts = []
    for folder in dict.fromkeys(options.folders):
        try:
            parts.append(read_part(folder))
        except (OSError, UsageError) as error:
            errors.append(str(error))
    if not errors and parts:
        parts.sort(key=lambda part: part.share.part)
        errors = list(_differences(parts, options.any_processor)) or list(_wrong_numbers(parts))
        errors = errors or gaps_and_overlaps(parts, parts[0].manifest)
    if errors or not parts:
        raise UsageError(f"the parts are not merged: {'; '.join(errors) or 'no folder is given'}")
    return parts


def _differences(parts: Sequence[StoredPart], any_processor: bool) -> Iterator[str]:
    """Yield a text for each group of parts that have other inputs than most parts have.

    Args:
        parts: All parts, in the order of their numbers.
        any_processor: True if the processors of the parts may differ.

    Yields:
        Folders of the group, and the inputs that differ.
    """
    manifests_of_parts = [part.manifest for part in parts]
    if any_processor:
        manifests_of_parts = [_on_processor_of(each, manifests_of_parts[0]) for each in manifests_of_parts]
    counts = Counter(each.fingerprint for each in manifests_of_parts)
    fingerprint = max(counts, key=counts.__getitem__)
    reference_index = [each.fingerprint for each in manifests_of_parts].index(fingerprint)
    reference = manifests_of_parts[reference_index]
    groups = defaultdict(list)
    for part, each in zip(parts, manifests_of_parts, strict=True):
        texts = [*_changed_options(reference, each), *manifests.differences(reference, each)]
        if each.fingerprint != fingerprint and not texts:
            texts = ["an input is another one"]
        if texts:
            groups["; ".join(texts)].append(str(part.folder))
    for text, folders in groups.items():
        verb = "is" if len(folders) == 1 else "are"
        yield f"{', '.join(folders)} {verb} of another run than {parts[reference_index].folder}: {text}"


def _on_processor_of(manifest: Manifest, other: Manifest) -> Manifest:
    """Return a `manifest` with the processor of the manifest `other` in place of its own."""
    versions = dict(manifest.versions) | {name: other.versions.get(name) for name in PROCESSOR_VERSIONS}
    return replace(manifest, cpu=other.cpu, versions=versions).with_fingerprint()


def _changed_options(then: Manifest, now: Manifest) -> Iterator[str]:
    """Yield a text for each option that differs between two parts: `--seed was 0 and is 1`.

    The options of the hardware are left out, because `manifests.differences` describes them.

    Args:
        then: Manifest of one part.
        now: Manifest of another part.

    Yields:
        Description of one difference.
    """
    ignored = {"part", *asdict(then.hardware)}
    for name in [name for name in then.options if name not in ignored]:
        if (before := then.options[name]) != (after := now.options.get(name)):
            yield f"--{name} was {_words(before)} and is {_words(after)}"


def _words(value: object) -> str:
    """Return the value of an option as on the command line."""
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)


def _wrong_numbers(parts: Sequence[StoredPart]) -> Iterator[str]:
    """Yield a text for each part that is missing or given twice, and for parts of another number of parts.

    Args:
        parts: All parts, in the order of their numbers.

    Yields:
        Description of one fault.
    """
    counts = Counter(part.share.part.count for part in parts)
    count = max(counts, key=counts.__getitem__)
    folders = defaultdict(list)
    for part in parts:
        folders[part.share.part].append(str(part.folder))
    for part_number, names in folders.items():
        if part_number.count != count:
            yield f"{', '.join(names)} holds part {part_number}, the others parts of {count}"
        if len(names) > 1:
            yield f"{' and '.join(names)} hold both part {part_number}"
    present = {part_number.number for part_number in folders if part_number.count == count}
    if missing := [str(number) for number in range(1, count + 1) if number not in present]:
        noun = "part" if len(missing) == 1 else "parts"
        yield f"{noun} {', '.join(missing)} of {count} missing"


def _merged_manifest(parts: Sequence[Manifest]) -> Manifest:
    """Return the manifest of the whole run.

    Args:
        parts: Manifests of all parts, in the order of their numbers.

    Returns:
        The manifest of the first part without its share, with the earliest date and the processors of all parts.
    """
    first = parts[0]
    processors = dict.fromkeys(part.cpu for part in parts)
    versions = dict(first.versions)
    for name in PROCESSOR_VERSIONS:
        versions[name] = " or ".join(dict.fromkeys(str(part.versions.get(name)) for part in parts))
    merged = replace(
        first,
        share=None,
        options=dict(first.options) | {"part": None},
        date=min(part.date for part in parts),
        cpu=" or ".join(processors),
        versions=versions,
    )
    return merged.with_fingerprint()
