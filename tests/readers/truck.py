"""What the messages of a truck mean: by J1939 but for its gears, all with sender FE."""

DBC = """VERSION ""
BU_: X
BO_ 2566844926 CCVS1: 8 X
 SG_ WheelSpeed : 8|16@1+ (0.00390625,0) [0|250.996] "km/h" X
BO_ 2565868030 VDC2: 8 X
 SG_ YawRate : 24|16@1+ (0.0001220703125,-3.92) [-3.92|3.92] "rad/s" X
BO_ 2364473598 To: 8 X
 SG_ ToSpeed : 0|16@1+ (0.00390625,0) [0|250.996] "km/h" X
BO_ 800 Gears: 1 X
 SG_ Gear : 0|4@1+ (1,0) [0|15] "" X
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","reserved","J1939PG";
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_ "VFrameFormat" BO_ 2566844926 3;
BA_ "VFrameFormat" BO_ 2565868030 3;
BA_ "VFrameFormat" BO_ 2364473598 3;
"""
