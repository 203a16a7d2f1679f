// The bodies of loops, for what instantiates their launchers.
KNEAD_BODY(LoopBegin)
KNEAD_BODY(LoopGo)
KNEAD_BODY(LoopEnd)
KNEAD_BODY(LoopCommit)
KNEAD_BODY(CopyWords)
