rule import_segmentation:
    input:
        segmentation=segmentation_of,
        plan=plan_of,
    output:
        labels="<results>/cases/{case}/labels.nii.gz",
        bone="<results>/cases/{case}/bone.vtp",
        skin="<results>/cases/{case}/skin.vtp",
        plan="<results>/cases/{case}/plan.json",
        report="<results>/cases/{case}/import.json",
    log:
        "<logs>/import_segmentation/{case}.log",
    benchmark:
        "<benchmarks>/import_segmentation/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=10,
    params:
        labels=config["labels"],
        segments=config["segments"],
        orientation=config["orientation"],
        repair=config["repair"],
        unlabelled_muscle=config["unlabelled_muscle"],
        bone_edge=config["mesh"]["bone_edge"],
        code=code_of("import_segmentation"),
    message:
        "Import the segmentation and the plan of {wildcards.case}"
    script:
        "../scripts/import_segmentation.py"


rule register_postop:
    input:
        postop=postop_of,
        skin="<results>/cases/{case}/skin.vtp",
        bone="<results>/cases/{case}/bone.vtp",
    output:
        postop="<results>/cases/{case}/postop.h5",
    log:
        "<logs>/register_postop/{case}.log",
    benchmark:
        "<benchmarks>/register_postop/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=10,
    params:
        segments=config["segments"],
        nasion_above_maxilla=config["interfaces"]["nasion_above_maxilla"],
        limit=config["registration"]["limit"],
        code=code_of("register_postop"),
    message:
        "Register the post-operative skin of {wildcards.case} on the upper face"
    script:
        "../scripts/register_postop.py"


# Every file that a user gave has been read and checked before any heavy work starts.
rule check_cohort:
    input:
        imports=expand("<results>/cases/{case}/import.json", case=CASES),
        postops=(
            [] if VIRTUAL else expand("<results>/cases/{case}/postop.h5", case=SCANNED)
        ),
    output:
        table=ensure("<results>/cohort.csv", non_empty=True),
    log:
        "<logs>/check_cohort.log",
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=1000,
        runtime=5,
    params:
        cases=list(CASES),
        code=code_of("check_cohort"),
    message:
        "All {input.imports} are read and checked"
    script:
        "../scripts/check_cohort.py"


rule tetrahedralize:
    input:
        labels="<results>/cases/{case}/labels.nii.gz",
        checked=ancient("<results>/cohort.csv"),
    output:
        mesh="<results>/cases/{case}/mesh.vtu",
    log:
        "<logs>/tetrahedralize/{case}.log",
    benchmark:
        "<benchmarks>/tetrahedralize/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=4000,
        runtime=20,
    params:
        nodes=config["mesh"]["nodes"],
        minimum_dihedral=config["mesh"]["minimum_dihedral"],
        code=code_of("tetrahedralize"),
    message:
        "Mesh muscle and superficial tissue of {wildcards.case}"
    script:
        "../scripts/tetrahedralize.py"


rule label_interfaces:
    input:
        mesh="<results>/cases/{case}/mesh.vtu",
        labels="<results>/cases/{case}/labels.nii.gz",
        bone="<results>/cases/{case}/bone.vtp",
        skin="<results>/cases/{case}/skin.vtp",
        report="<results>/cases/{case}/import.json",
    output:
        model="<results>/cases/{case}/model.h5",
    log:
        "<logs>/label_interfaces/{case}.log",
    benchmark:
        "<benchmarks>/label_interfaces/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        segments=config["segments"],
        interfaces=config["interfaces"],
        code=code_of("label_interfaces"),
    message:
        "Label the interfaces of {wildcards.case}"
    script:
        "../scripts/label_interfaces.py"


rule meshes:
    input:
        expand("<results>/cases/{case}/model.h5", case=CASES),
    message:
        "All patients are meshed and labelled"


# The mesh and the model of the methods that resolve the lips.
rule refine_lips:
    input:
        mesh="<results>/cases/{case}/mesh.vtu",
        labels="<results>/cases/{case}/labels.nii.gz",
        bone="<results>/cases/{case}/bone.vtp",
    output:
        mesh="<results>/cases/{case}/lips/mesh.vtu",
    log:
        "<logs>/refine_lips/{case}.log",
    benchmark:
        "<benchmarks>/refine_lips/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        segments=config["segments"],
        sliding_band=config["interfaces"]["sliding_band"],
        lip_edge=config["fem_rlse"]["lip_edge"],
        code=code_of("refine_lips"),
    message:
        "Refine the mesh of {wildcards.case} around the mouth"
    script:
        "../scripts/refine_lips.py"


use rule label_interfaces as label_lips with:
    input:
        mesh="<results>/cases/{case}/lips/mesh.vtu",
        labels="<results>/cases/{case}/labels.nii.gz",
        bone="<results>/cases/{case}/bone.vtp",
        skin="<results>/cases/{case}/skin.vtp",
        report="<results>/cases/{case}/import.json",
    output:
        model="<results>/cases/{case}/lips/model.h5",
    log:
        "<logs>/label_lips/{case}.log",
    benchmark:
        "<benchmarks>/label_lips/{case}.tsv"
    message:
        "Label the interfaces of {wildcards.case} on the mesh that resolves the lips"


rule report_quality:
    input:
        model="<results>/cases/{case}/model.h5",
        imported="<results>/cases/{case}/import.json",
    output:
        report="<results>/cases/{case}/quality.json",
        picture="<results>/cases/{case}/quality.png",
    log:
        "<logs>/report_quality/{case}.log",
    benchmark:
        "<benchmarks>/report_quality/{case}.tsv"
    conda:
        "../envs/pinnochio.yaml"
    threads: 1
    resources:
        mem_mb=2000,
        runtime=10,
    params:
        code=code_of("report_quality"),
    message:
        "Report the quality of the model of {wildcards.case}"
    script:
        "../scripts/report_quality.py"


rule quality:
    input:
        table_and_twins("quality"),
        expand("<results>/cases/{case}/quality.png", case=CASES),
    message:
        "The quality of every patient's model is reported"
