// SPDX-License-Identifier: GPL-3.0-or-later

// A job type of Flamenco: bakes a library of measured materials, and makes an asset library of it if asked to.
//
// Put this file into the folder "scripts" beside flamenco-manager. Jobs for it are written by
//     bake library FILES|FOLDERS|LIST --out LIB --export flamenco
// See addon/docs/farm.md of Measured Materials.

const JOB_TYPE = {
    label: "Measured Library",
    description: "Bake measurements, photographs and formulas to materials, each by a task of its own",
    settings: [
        { key: "library", type: "string", subtype: "dir_path", required: true,
          description: "Folder of the library, which all workers see" },
        { key: "materials", type: "string", required: true, visible: "hidden",
          description: "What to bake, as JSON: a list of names and of the words behind 'bake library'" },
        { key: "list", type: "string", subtype: "file_path", required: true, visible: "web",
          description: "The same as a list, by which the last task makes sure of it and writes the table" },
        { key: "root", type: "string", subtype: "dir_path", default: "", visible: "web",
          description: "Folder that stands for {root} in what to bake; a two-way variable of the manager may replace it" },
        { key: "assets", type: "string", subtype: "dir_path", default: "", visible: "web",
          description: "Folder of an asset library to make of the materials; empty for none" },
        { key: "chunk_size", type: "int32", default: 1, propargs: {min: 1},
          description: "Materials that one task bakes, one after the other" },
        { key: "program", type: "string", default: "{blender}", visible: "web",
          description: "Blender with the extension, or a Python that has the package" },
        { key: "program_arguments", type: "string", default: "--background --command measured_materials", visible: "web",
          description: "Words before 'bake library'; of a Python: -P -m measured_materials" },
    ]
};

// Above the usual 50: a library that is baked gets its table before the tasks of other jobs, and of its own others.
const TABLE_PRIORITY = 75;

function compileJob(job) {
    const settings = job.settings;
    const materials = parsedMaterials(settings.materials);
    const chunkSize = settings.chunk_size || 1;
    if (chunkSize < 1) {
        throw "chunk_size is below 1";
    }

    const tableTask = author.Task("table", "blender");
    tableTask.priority = TABLE_PRIORITY;
    for (let first = 0; first < materials.length; first += chunkSize) {
        const chunk = materials.slice(first, first + chunkSize);
        const task = author.Task(nameOf(chunk), "blender");
        for (const material of chunk) {
            // What no worker could bake is no fault of this one, which would be blocked for it: the table tells of it. No
            // memory, no disk or no share is its own, and fails the task.
            task.addCommand(command(settings, ["bake", "library", ...material.arguments,
                "--out", settings.library, "--task", "--exit-zero"]));
        }
        job.addTask(task);
        tableTask.addDependency(task);
    }
    // Keeps what is finished, bakes once more what is not, and fails where something still is not.
    const assets = settings.assets ? ["--assets", settings.assets] : [];
    tableTask.addCommand(command(settings, ["bake", "library", settings.list, "--out", settings.library, ...assets]));
    job.addTask(tableTask);
}

function parsedMaterials(text) {
    let materials;
    try {
        materials = JSON.parse(text);
    } catch (error) {
        throw "the setting 'materials' is not JSON: write the job by bake library --export flamenco";
    }
    const isMaterial = (one) => one && typeof one.name === "string" && one.name !== "" && Array.isArray(one.arguments)
        && one.arguments.length > 0 && one.arguments.every((word) => typeof word === "string");
    if (!Array.isArray(materials) || materials.length === 0 || !materials.every(isMaterial)) {
        throw "the setting 'materials' lists no materials: write the job by bake library --export flamenco";
    }
    return materials;
}

function nameOf(chunk) {
    const last = chunk[chunk.length - 1].name;
    return chunk.length === 1 ? last : `${chunk[0].name} to ${last}`;
}

function command(settings, words) {
    const here = (word) => settings.root ? word.split("{root}").join(settings.root) : word;
    return author.Command("exec", {
        exe: settings.program || "{blender}",
        args: shellSplit(settings.program_arguments || "").concat(words.map(here)),
    });
}
