// The solver's bodies over the other structures, for what instantiates their launchers.
KNEAD_BODY(RestoreVolumeOn<JaggedTable>)
KNEAD_BODY(RestoreVolumeOn<EllTable>)
KNEAD_BODY(RestoreVolumeOn<SlicedTable>)
KNEAD_BODY(RestoreVolumeOn<CsrTable>)
KNEAD_BODY(EnforceStiffnessOn<JaggedTable>)
KNEAD_BODY(EnforceStiffnessOn<EllTable>)
KNEAD_BODY(EnforceStiffnessOn<SlicedTable>)
KNEAD_BODY(EnforceStiffnessOn<CsrTable>)
