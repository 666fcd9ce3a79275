"""ACMT-Net, FSC-Net and DGCFP: the patient as points, their losses, their training and their prediction."""
