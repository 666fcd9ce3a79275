# Patients on meshes of other sizes than the study's.


use rule tetrahedralize as tetrahedralize_size with:
    output:
        mesh="<results>/sizes/{nodes}/{case}/mesh.vtu",
    log:
        "<logs>/tetrahedralize_size/{nodes}_{case}.log",
    benchmark:
        "<benchmarks>/tetrahedralize_size/{nodes}_{case}.tsv"
    params:
        nodes=lambda wildcards: int(wildcards.nodes),
        minimum_dihedral=config["mesh"]["minimum_dihedral"],
        code=code_of("tetrahedralize"),
    message:
        "Mesh {wildcards.case} with {wildcards.nodes} nodes"


use rule label_interfaces as label_size with:
    input:
        mesh="<results>/sizes/{nodes}/{case}/mesh.vtu",
        labels="<results>/cases/{case}/labels.nii.gz",
        bone="<results>/cases/{case}/bone.vtp",
        skin="<results>/cases/{case}/skin.vtp",
        report="<results>/cases/{case}/import.json",
    output:
        model="<results>/sizes/{nodes}/{case}/model.h5",
    log:
        "<logs>/label_size/{nodes}_{case}.log",
    benchmark:
        "<benchmarks>/label_size/{nodes}_{case}.tsv"
    message:
        "Label the interfaces of {wildcards.case} with {wildcards.nodes} nodes"


use rule make_lift as make_size_lift with:
    input:
        model="<results>/sizes/{nodes}/{case}/model.h5",
    output:
        lift="<results>/sizes/{nodes}/{case}/lift_{kind}.h5",
    log:
        "<logs>/make_size_lift/{nodes}_{case}_{kind}.log",
    benchmark:
        "<benchmarks>/make_size_lift/{nodes}_{case}_{kind}.tsv"
    message:
        "Make the {wildcards.kind} lift of {wildcards.case} with {wildcards.nodes} nodes"
